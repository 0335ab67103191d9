"""What is assumed of trials without a gait, as where only the first row of a day names one."""

import pandas as pd

from sandbot_record.trials.frame import from_frame
from sandbot_record.trials.gaits import with_only_gait
from sandbot_record.trials.read import read
from sandbot_record.trials.table import Row


def gaits(*names, **more):
    rows, notes = with_only_gait([Row(trial_id=f"t{at}", gait=name, **more) for at, name in enumerate(names)])
    return [row.gait for row in rows], notes


def test_a_trial_without_a_gait_was_run_in_the_only_one_that_others_name():
    note = "2 trials without a gait: UNIFORM is assumed, the only one that others name"
    assert gaits("UNIFORM", "", "UNIFORM", "") == (["UNIFORM"] * 4, [note])


def test_of_several_gaits_and_of_none_nothing_is_assumed_here():
    for names in (["UNIFORM", "", "HGCS"], ["", ""], ["SGCS", "SGCS"]):
        assert gaits(*names) == (names, [])


def test_a_trial_that_does_not_count_names_no_gait_for_others():
    named, unnamed = Row(trial_id="a", gait="HGCS", status="fell over"), Row(trial_id="b")
    assert with_only_gait([named, unnamed]) == ([named, unnamed], [])


def test_a_table_and_a_frame_are_read_alike(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("phi,omega_rad_s,gait,speed_m_s\n0.6,8,UNIFORM,0.08\n0.61,8,,0.09\n")
    for trials in (read(table), from_frame(pd.read_csv(table))):
        assert [*trials.gait] == ["UNIFORM", "UNIFORM"]
        assert any("1 trial without a gait" in note for note in trials.unread)
