import dataclasses
import json

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.config import files_of
from sandbot_bringup.plan import Plan, check_bed, plan_of, read_plan, to_yaml, trials_of, with_next_trials
from sandbot_bringup.power_analysis import detectable_effects, gaps
from sandbot_bringup.tools import campaign
from sandbot_common.errors import InputError
from sandbot_model.discovery import power

GOOD = {"name": "a", "phi": [0.58, 0.6], "omega_rad_s": [4, 16], "replicates": 2, "gait": "UNIFORM"}


def test_grid_becomes_trials_in_order_with_names_and_seeds_of_their_own():
    trials = trials_of(plan_of(GOOD, "plan"))
    assert [(t.phi, t.omega_rad_s, t.replicate) for t in trials[:3]] == [(0.58, 4, 1), (0.58, 4, 2), (0.58, 16, 1)]
    assert len({t.trial_id for t in trials}) == len({t.seed for t in trials}) == 8


def test_a_trials_seed_does_not_depend_on_the_others():
    small = trials_of(plan_of({**GOOD, "phi": [0.6]}, "plan"))
    large = {t.trial_id: t.seed for t in trials_of(plan_of(GOOD, "plan"))}
    assert all(large[t.trial_id] == t.seed for t in small)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"replicats": 3}, "unknown key 'replicats', did you mean 'replicates'"),
        ({"phi": [0.58, 0.9]}, r"phi: 0.9 is outside \[0.57, 0.64\]"),
        ({"phi": [float("nan")]}, "phi: nan is not a finite number"),
        ({"phi": []}, "the list is empty"),
        ({"phi": 0.6}, "phi: 0.6 is not a list"),
        ({"phi": [0.6, 0.6]}, "0.6 is listed twice"),
        ({"omega_rad_s": ["fast"]}, "'fast' is not a number"),
        ({"replicates": 0}, "replicates: 0 is outside"),
        ({"replicates": True}, "not a whole number"),
        ({"gait": "TROT"}, "'TROT' is not one of SGCS, HGCS, UNIFORM, CUSTOM"),
        ({"gait": "CUSTOM", "gait_parameters": {"duty": 2.0}}, "duty: 2.0 is outside"),
        ({"gait_parameters": {"duty": 0.5}}, "set gait: CUSTOM"),
        ({"bed": {"tolerence": 1}}, "did you mean 'tolerance'"),
        ({"extra_trials": [{"phi": 0.6}]}, r"extra_trials\[0\]: missing key 'omega_rad_s'"),
        ({"name": None}, "name: None is not a string"),
        *(({"name": name}, "name: .* can't be the name of a folder") for name in ("", "..", "../x", "/tmp/x", "a\nb")),
    ],
)
def test_a_bad_plan_is_refused_in_one_line_that_names_key_and_value(change, message):
    with pytest.raises(InputError, match=message) as caught:
        plan_of({**GOOD, **change}, "plan.yaml")
    assert str(caught.value).startswith("plan.yaml")
    assert "\n" not in str(caught.value)


def test_missing_key_is_named():
    with pytest.raises(InputError, match="missing key 'phi'"):
        plan_of({"name": "a", "omega_rad_s": [4]}, "plan")


def test_yaml_round_trip(tmp_path):
    plan = plan_of({**GOOD, "extra_trials": [{"phi": 0.61, "omega_rad_s": 20.0}]}, "plan")
    (tmp_path / "campaign.yaml").write_text(to_yaml(plan))
    assert read_plan(tmp_path / "campaign.yaml") == plan


@given(st.binary(max_size=200))
def test_any_bytes_give_a_plan_or_one_line(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("plan") / "campaign.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_plan(path)
    assert "\n" not in str(caught.value)


def test_next_trials_become_extra_conditions_counted_on_from_the_grid(tmp_path):
    path = tmp_path / "next.json"
    proposals = [
        {"phi": 0.6, "omega_rad_s": 16, "observable": "speed", "separates": ["a", "b"], "expected_gap_sd": 4.0},
        {"phi": 0.6, "omega_rad_s": 16, "observable": "lift", "separates": ["a", "b"], "expected_gap_sd": 3.0},
        {"phi": 0.61, "omega_rad_s": 18, "observable": "lift", "replicates": 5},
    ]
    path.write_text(json.dumps({"next_trials": proposals}))
    trials = trials_of(with_next_trials(plan_of(GOOD, "plan"), path))[8:]
    assert [(t.phi, t.omega_rad_s, t.replicate) for t in trials[:2]] == [(0.6, 16, 3), (0.6, 16, 4)]
    assert len(trials) == 2 + 5


@pytest.mark.parametrize(("gait", "own"), [("SGCS", "SGCS"), ("UNIFORM", ""), ("", ""), (None, "")])
def test_next_trials_run_in_the_gait_that_they_are_meant_for(tmp_path, gait, own):
    """Control: the plan's gait, and none, are none of their own."""
    path = tmp_path / "next.json"
    asked = {"phi": 0.61, "omega_rad_s": 18, "replicates": 1} | ({} if gait is None else {"gait": gait})
    path.write_text(json.dumps({"next_trials": [asked]}))
    plan = with_next_trials(plan_of(GOOD, "plan"), path)
    assert [trial.gait for trial in trials_of(plan)][8:] == [own]
    assert with_next_trials(plan, path) == plan


@pytest.mark.parametrize(
    "text",
    [
        '{"schema": "sandbot.discovery/9", "next_trials": [{"phi": 0.61, "omega_rad_s": 18}]}',
        "",
        "{}",
        '{"next_trials": []}',
        '{"next_trials": [1]}',
        '{"next_trials": [{"phi": 2}]}',
    ],
)
def test_a_useless_next_trials_file_is_refused(tmp_path, text):
    path = tmp_path / "next.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"next\.json"):
        with_next_trials(plan_of(GOOD, "plan"), path)


def test_penetrometer_readings_among_the_next_trials_are_left_to_the_penetrometer(tmp_path):
    path = tmp_path / "next.json"
    reading = {"phi": 0.6, "omega_rad_s": None, "observable": "penetration_force", "depth_m": 0.02}
    path.write_text(json.dumps({"next_trials": [reading, {"phi": 0.61, "omega_rad_s": 18, "replicates": 2}]}))
    assert len(trials_of(with_next_trials(plan_of(GOOD, "plan"), path))) == 8 + 2
    path.write_text(json.dumps({"next_trials": [reading]}))
    with pytest.raises(InputError, match="penetrometer"):
        with_next_trials(plan_of(GOOD, "plan"), path)


def test_yaml_that_is_a_list_is_refused(tmp_path):
    path = tmp_path / "campaign.yaml"
    path.write_text(yaml.safe_dump([1, 2]))
    with pytest.raises(InputError, match=r": lines .key: value. are needed"):
        read_plan(path)


def test_conditions_that_share_a_name_are_one_and_count_on():
    """A proposed φ of 0.58332 took the name of a trial at 0.58333, and counted as run."""
    plan = Plan(
        name="h", phi=(0.58333,), omega_rad_s=(16.0,), replicates=1,
        extra_trials=({"phi": 0.58332, "omega_rad_s": 16.0001, "replicates": 2},),
    )  # fmt: skip
    names = [trial.trial_id for trial in trials_of(plan)]
    assert names == [f"phi0.5833_w16.000_r0{number}" for number in (1, 2, 3)]
    assert [trial.phi for trial in trials_of(plan)] == [0.58333, 0.58332, 0.58332]


@pytest.mark.parametrize(
    ("key", "values"), [("phi", [0.60001, 0.60002]), ("omega_rad_s", [8.0, 8.0001]), ("phi", [0.6, 0.6])]
)
def test_values_that_names_can_not_tell_apart_are_refused(key, values):
    with pytest.raises(InputError, match=f"{key}: .* is listed twice"):
        plan_of({**GOOD, key: values}, "plan")
    apart = {"phi": [0.6001, 0.6002], "omega_rad_s": [8.0, 8.001]}[key]
    assert plan_of({**GOOD, key: apart}, "plan")


def test_the_virtual_labs_bed_is_asked_for_every_phi():
    check_bed(plan_of({**GOOD, "phi": [0.59, 0.63]}, "plan"))
    for odd in ({"phi": [0.59, 0.575]}, {"extra_trials": [{"phi": 0.575, "omega_rad_s": 8.0}]}):
        with pytest.raises(InputError, match=r"phi: bed: target_phi 0.575 can't be reached"):
            check_bed(plan_of({**GOOD, **odd}, "plan"))


LOOSE = {"mass_kg": 79.75, "rho_grain_kg_m3": 1100.0, "area_m2": 1.25, "height_loose_m": 0.1}


@pytest.mark.parametrize(("phi", "bed"), [(0.62, {"phi_close": 0.6}), (0.575, LOOSE)])
def test_a_live_bed_is_asked_for_a_phi_beyond_the_end_that_the_plan_sets(phi, bed):
    with pytest.raises(InputError, match=f"target_phi {phi} can't be reached"):
        check_bed(plan_of({**GOOD, "phi": [phi], "bed": bed}, "plan"), live=True)
    # Control: the bed node's own settings may reach it.
    check_bed(plan_of({**GOOD, "phi": [0.575, 0.64], "bed": {"max_pulses": 8}}, "plan"), live=True)


@pytest.mark.parametrize("rate_hz", [50.0, 200.0])
def test_a_trial_has_a_whole_steady_period(rate_hz):
    """However its set-points are rounded, and if the legs lag by half a frame; longer trials are as long as asked."""
    plan = plan_of({**GOOD, "periods": 2, "min_duration_s": 0.2, "setpoint_rate_hz": rate_hz}, "plan")
    for omega in np.linspace(2, 30, 57):
        period_s = 2 * np.pi / omega
        assert 2 * period_s + 0.005 <= plan.setpoint_times_s(omega)[-1] <= 2 * period_s + 0.035
        assert dataclasses.replace(plan, periods=4).duration_s(omega) == 4 * period_s


def test_what_trials_are_too_short_for_is_said_and_not_counted_on(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(campaign, "detectable_effects", lambda *_: "")
    path, said = tmp_path / "plan.yaml", {}
    for periods in (2, 4):
        extra = {"phi": 0.6, "omega_rad_s": 20, "gait": "SGCS"}
        path.write_text(json.dumps({**GOOD, "periods": periods, "min_duration_s": 0.2, "extra_trials": [extra]}))
        assert campaign.main([str(path), "--dry-run"]) == 0
        said[periods] = [line for line in capsys.readouterr().out.split("\n") if line.startswith("note: ")]
    why = "lift_m, peak_speed_m_s ({} frames in steady steps, at least 32 are needed); raise periods or min_duration_s"
    assert said[2] == [
        f"note: not measured at 16 rad/s: {why.format(19)}",
        f"note: not measured at 20 rad/s in SGCS: {why.format(15)}",
    ]
    assert said[4] == []


def test_the_forecast_does_without_what_is_not_measured(tmp_path, monkeypatch):
    seen = []

    def expected(design):
        seen.append(design)
        raise InputError("enough")

    monkeypatch.setattr(power, "expected", expected)
    plan = plan_of({**GOOD, "periods": 2, "min_duration_s": 0.2}, "plan")
    trials, files = trials_of(plan), files_of(plan, tmp_path, tmp_path)
    assert "enough" in detectable_effects(plan, trials, files, gaps(plan, trials, files))
    assert np.isnan(seen[0].lift_m).tolist() == (seen[0].omega_rad_s == 16).tolist()
    assert np.isfinite(seen[0].speed_m_s).all()
