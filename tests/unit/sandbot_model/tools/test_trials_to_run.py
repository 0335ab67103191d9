"""discover --next: what is to be measured as a table that is filled in and given back."""

import csv
from dataclasses import replace

import pytest

from sandbot_common.errors import InputError
from sandbot_model.data.penetrometer import read_readings
from sandbot_model.discovery.next_trials import PENETRATION, NextTrial
from sandbot_model.tools import discover
from sandbot_model.tools.trials_to_run import write_trials_to_run
from sandbot_record.trials.csv_table import read_csv

SLOW = NextTrial(0.6, 8.0, "speed", ("leg_slip", "cable_drag"), 3.0, 2, gait="SGCS")
FAST = NextTrial(0.62, 20.0, "lift", ("leg_slip", "cable_drag"), 2.0, 1)
SET = ("trial_id", "phi", "omega_rad_s", "gait", "replicate", "speed_m_s")
PRESSED = NextTrial(0.6, float("nan"), PENETRATION, ("leg_slip", "cable_drag"), 2.0, 1, depth_m=0.01)


def test_each_replicate_is_a_row_of_its_own_and_conditions_take_turns(tmp_path):
    path = tmp_path / "next.csv"
    said = write_trials_to_run([SLOW, FAST], 40, path, "")
    with path.open() as file:
        rows = [tuple(row[name] for name in SET) for row in csv.DictReader(file)]
    assert rows == [
        ("next041", "0.6", "8", "SGCS", "1", ""),
        ("next042", "0.62", "20", "", "1", ""),
        ("next043", "0.6", "8", "SGCS", "2", ""),
    ]
    assert said == f"{path}: 3 trials to run and to fill in; then give both tables to discover"


def test_a_filled_table_is_read(tmp_path):
    path = tmp_path / "next.csv"
    write_trials_to_run([FAST], 3, path, "")
    head, row = path.read_text().splitlines()
    cells = row.split(",")
    cells[head.split(",").index("speed_m_s")] = "0.2"
    path.write_text(f"{head}\n{','.join(cells)}\n")
    assert read_csv(path).usable.tolist() == [True]


def test_readings_are_a_table_of_their_own_in_turn(tmp_path):
    path, readings = tmp_path / "next.csv", tmp_path / "next.readings.csv"
    deeper = replace(PRESSED, depth_m=0.02, replicates=2)
    said = write_trials_to_run([PRESSED, FAST, deeper], 40, path, "")
    assert said == (
        f"{path}: 1 trials to run and to fill in; then give both tables to discover. "
        f"{readings}: 3 readings to make and to fill in; then give it to discover with --penetrometer"
    )
    assert readings.read_text() == "phi,depth_m,force_n\n0.6,0.01,\n0.6,0.02,\n0.6,0.02,\n"
    with pytest.raises(InputError, match="row 2, force_n: '' is not a number"):
        read_readings(readings)
    readings.write_text(readings.read_text().replace(",\n", ",1.5\n"))
    assert read_readings(readings).force_n.tolist() == [1.5] * 3


@pytest.mark.parametrize("proposed", [[], [PRESSED]], ids=["nothing", "readings only"])
def test_without_a_trial_to_run_there_is_no_table_of_trials(proposed, tmp_path):
    path = tmp_path / "next.csv"
    said = write_trials_to_run(proposed, 3, path, "no trial is proposed: none is needed")
    assert said.startswith(f"{path} is not written, because no trial is proposed: none is needed")
    assert [file.name for file in tmp_path.iterdir()] == ["next.readings.csv"] * len(proposed)


@pytest.mark.parametrize("filled", ["next.csv", "next.readings.csv"])
def test_a_table_that_may_be_filled_in_is_never_overwritten(tmp_path, filled):
    data = tmp_path / "data.csv"
    for table in (data, tmp_path / filled):
        table.write_text("phi,omega_rad_s,speed_m_s\n0.6,8,0.1\n")
    with pytest.raises(InputError, match="is there already, perhaps filled in"):
        discover._discover([str(data), "--next", str(tmp_path / "next.csv")])
