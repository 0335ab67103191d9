"""Residuals in run order: a drift is drawn and tested, and a bed that stays as it is shows none."""

import dataclasses
import re

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable
from sandbot_model.report.run_order import caption, drawable, figure, residuals
from sandbot_record.trials.table import from_rows


@pytest.fixture(scope="module")
def run(drawn):
    """Trials in random order, each speed too high by ``drift`` standard deviations at the end, and their fit."""

    def make(drift=0.0):
        rows = drawn(seed=3, levels=3, omega=(4, 8, 12, 16)).rows()
        place = np.random.default_rng(0).permutation(len(rows)) + 1.0
        rows = [
            dataclasses.replace(row, run_order=at, speed_m_s=row.speed_m_s + 0.005 * drift * at / len(rows))
            for row, at in zip(rows, place, strict=True)
        ]
        trials = from_rows(rows)
        return trials, fit(model_of("simple", (), catalogue()), cells_of(trials))

    return make


def test_residuals_are_those_of_the_trials_in_the_order_they_were_run(run):
    trials, fitted = run()
    order, z, cell = residuals(trials, fitted)
    assert sorted(order) == list(range(1, len(order) + 1))
    np.testing.assert_array_equal(fitted.cells.omega[cell], trials.omega_rad_s)
    expected = (trials.lift_m - fitted.predicted[cell, Observable.lift]) / fitted.cells.noise[Observable.lift]
    np.testing.assert_allclose(z[:, Observable.lift], expected)


def test_what_is_not_fitted_of_a_cell_has_no_residual(run):
    """Peaks of which it is open whether the cameras saw them."""
    trials, fitted = run()
    uneven = dataclasses.replace(trials, gait=np.full(len(trials), "HGCS"))
    refitted = fit(fitted.model, cells_of(uneven))
    _, z, cell = residuals(uneven, refitted)
    seen = np.isfinite(refitted.cells.mean[cell])
    assert 0 < seen[:, Observable.peak_speed].sum() < len(cell)
    assert np.isnan(z[~seen]).all()
    assert np.isfinite(z[:, Observable.speed]).all()


def test_a_drift_is_told_and_a_steady_bed_has_none(run):
    assert re.search(r"mean speed \+[2-6]\.\d \(p < 0\.001\)", caption(*run(6.0)))
    assert "mean speed" in caption(*run())
    assert "< 0.001" not in caption(*run())


def test_every_observable_is_drawn_with_its_units(run):
    spec = figure(*run())
    assert [one["name"] for one in spec["data"]] == ["mean speed", "body lift", "peak speed", "first step"]
    assert "s.d. of one trial" in spec["layout"]["yaxis"]["title"]["text"]


def test_one_far_trial_does_not_flatten_the_others_and_is_named(run):
    trials, fitted = run()
    spec = figure(trials, fitted)
    assert spec["layout"]["yaxis"]["range"] == pytest.approx([-6.6, 6.6])
    assert "Beyond" not in caption(trials, fitted)
    far = trials.peak_speed_m_s.copy()
    far[4] += 40.0 * fitted.cells.noise[Observable.peak_speed]
    trials = dataclasses.replace(trials, peak_speed_m_s=far)
    spec = figure(trials, fitted)
    edge = spec["data"][-1]
    assert spec["layout"]["yaxis"]["range"] == pytest.approx([-6.6, 6.6])
    assert (edge["y"], edge["marker"]["symbol"], edge["text"]) == ([6.0], ["triangle-up"], ["peak speed"])
    assert re.search(rf"{trials.trial_id[4]} \(peak speed \+[34]\d\)", caption(trials, fitted))


def test_where_many_trials_are_far_the_axis_reaches_them(run):
    trials, fitted = run()
    off = dataclasses.replace(trials, lift_m=trials.lift_m + 20.0 * fitted.cells.noise[Observable.lift])
    assert figure(off, fitted)["layout"]["yaxis"]["range"][1] > 15.0


def test_without_an_order_nothing_is_drawn(run):
    trials, fitted = run()
    assert drawable(trials, fitted)
    assert not drawable(dataclasses.replace(trials, run_order=np.full(len(trials.phi), np.nan)), fitted)
