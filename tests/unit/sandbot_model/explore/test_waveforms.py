"""Waveforms from bags, and the model's beside them."""

import shutil

import numpy as np
import pytest
from made_up import PACE, walking_bag

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.selection import Selection
from sandbot_model.report import waveforms
from sandbot_model.report.theme import LIGHT


def test_trials_of_a_cell_are_its_replicates(trials):
    cells = cells_of(trials)
    rows = waveforms.trials_of(trials, cells, 5)
    assert len(rows) == 2
    assert trials.omega_rad_s[rows] == pytest.approx(cells.omega[5])
    assert trials.phi[rows].mean() == pytest.approx(cells.phi[5])


def test_time_of_a_waveform_runs_from_the_start_of_the_legs(tmp_path):
    bag = walking_bag(tmp_path / "t00", v_x=lambda t: 0.1 * (t >= 0))
    (found,), missing = waveforms.read({"t00": bag}, ["t00"])
    assert missing == []
    assert found.time_s[[0, -1]] == pytest.approx([-0.2, 0.99])
    assert np.array_equal(found.speed_m_s > 0.05, found.time_s >= -1e-9)


def test_shaft_angles_become_those_of_the_legs(tmp_path):
    for name, mount in (("a", 0.0), ("b", 0.5)):
        walking_bag(tmp_path / name, v_x=lambda t: 0.0, mount=mount)
    (plain, mounted), _ = waveforms.read({name: tmp_path / name for name in "ab"}, ["a", "b"])
    assert mounted.leg_angle_rad == pytest.approx(plain.leg_angle_rad)


def test_the_modelled_waveform_is_the_arc_of_a_leg_that_holds(tmp_path, session):
    """v_x = Rω cos θ while |sin θ| ≤ s/2R, else 0: two stances a turn, of the step length the model predicts."""
    fit = session.step(Selection()).fit
    (cell,) = np.flatnonzero((fit.cells.level == 2) & (fit.cells.omega == 4))
    bag = walking_bag(tmp_path / "t00", v_x=lambda t: 0.0)
    (found,), _ = waveforms.read({"t00": bag}, ["t00"])
    speed = waveforms.modelled(found, fit, cell)
    radius = fit.model.robot.leg_radius_m
    holds = speed > 0
    angle = np.arcsin(np.sin(found.leg_angle_rad[:, 0]))
    assert speed[holds] == pytest.approx(radius * PACE * np.cos(angle[holds]))
    step = fit.predict(fit.cells.level_phi[2], fit.cells.omega[cell]).step_m
    assert np.array_equal(holds, (np.abs(np.sin(angle)) <= step / 2 / radius) & (found.leg_time_s >= 0))
    spec = waveforms.figure([found], fit, cell, LIGHT)
    assert [trace["name"] for trace in spec["data"]] == ["model", "t00"]
    assert max(spec["data"][0]["y"]) == pytest.approx(100 * radius * PACE, rel=0.01)
    assert "v<sub>x</sub> (cm/s)" in spec["layout"]["yaxis"]["title"]["text"]


def test_a_trial_run_again_under_its_name_is_read_again(tmp_path):
    bag = walking_bag(tmp_path / "t00", v_x=lambda t: 0.1)
    (before,), _ = waveforms.read({"t00": bag}, ["t00"])
    (untouched,), _ = waveforms.read({"t00": bag}, ["t00"])
    assert untouched is before
    shutil.rmtree(bag)
    assert waveforms.read({"t00": bag}, ["t00"])[0] == []
    walking_bag(bag, v_x=lambda t: 0.2)
    (after,), _ = waveforms.read({"t00": bag}, ["t00"])
    assert after.speed_m_s.max() == pytest.approx(0.2)


def test_without_leg_states_there_is_no_modelled_waveform(tmp_path, session):
    bag = walking_bag(tmp_path / "t00", v_x=lambda t: 0.1, legs=False)
    (found,), _ = waveforms.read({"t00": bag}, ["t00"])
    spec = waveforms.figure([found], session.step(Selection()).fit, 0, LIGHT)
    assert [trace["name"] for trace in spec["data"]] == ["t00"]


def test_a_bag_that_is_not_there_is_said(tmp_path):
    found, missing = waveforms.read({"a": tmp_path / "a"}, ["a", "b"])
    assert found == []
    assert [line.split(":")[0] for line in missing] == ["a", "b"]
    assert waveforms.read({}, ["a"])[1] == [
        "These trials come from a table: v_x(t) and film need a campaign folder or bags."
    ]
