import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_model.data.clustering import phi_levels, same_within
from sandbot_model.data.conditions import (
    cells_of,
    noise_floor,
    swum_at_once,
)
from sandbot_model.data.pure_error import pure_error
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.table import Row, from_rows


@given(
    st.integers(1, 8),
    st.integers(9, 24),
    st.floats(0.0, 7e-4),
    st.integers(0, 2**16),
)
def test_levels_are_the_targets(count, replicates, scatter, seed):
    """Targets 0.0075 apart or more, as seven between 0.580 and 0.633 are."""
    rng = np.random.default_rng(seed)
    targets = np.repeat(np.arange(count), replicates)
    phi = 0.57 + 0.0075 * targets + np.clip(rng.normal(0, 1, len(targets)), -2.5, 2.5) * scatter
    order = rng.permutation(len(phi))
    np.testing.assert_array_equal(phi_levels(phi[order]), targets[order])


def test_close_targets_are_told_apart_and_one_level_is_not_split():
    rng = np.random.default_rng(3)
    two = np.concatenate([rng.normal(0.6, 4e-4, 21), rng.normal(0.604, 4e-4, 21)])
    assert phi_levels(two).max() == 1
    for seed in range(20):
        assert phi_levels(np.random.default_rng(seed).normal(0.6, 7e-4, 21)).max() == 0


def test_frequencies_within_tolerance_are_one():
    np.testing.assert_array_equal(same_within(np.array([8.0, 4.0, 8.01, 4.001, 12.0]), 5e-3), [1, 0, 1, 0, 2])


def test_cells_hold_means_scatter_and_counts(drawn):
    trials = drawn(levels=3, omega=(8, 16))
    cells = cells_of(trials)
    assert len(cells) == 6
    assert cells.trials == 18
    assert cells.observables == ("speed", "lift", "peak_speed", "first_step")
    first = (trials.omega_rad_s == 8) & (trials.phi < 0.59)
    # The loosest level swims at 8 rad/s: nothing is there to bring to the level's φ.
    np.testing.assert_allclose(cells.mean[0, 0], trials.speed_m_s[first].mean())
    np.testing.assert_allclose(cells.sd[0, 0], trials.speed_m_s[first].std(ddof=1))
    assert (cells.n == 3).all()
    np.testing.assert_array_equal(cells.level, [0, 0, 1, 1, 2, 2])


def test_what_was_not_measured_is_absent_not_zero(drawn):
    trials = drawn(levels=3, omega=(8, 16))
    cells = cells_of(dataclasses.replace(trials, lift_m=np.full(18, np.nan)))
    assert cells.observables == ("speed", "peak_speed", "first_step")
    assert np.isnan(cells.mean[:, Observable.lift]).all()
    assert (cells.n[:, Observable.lift] == 0).all()


def test_failed_trials_are_left_out_and_counted(drawn):
    trials = drawn(levels=3, omega=(8, 16))
    status = trials.status.copy().astype("<U10")
    status[:2] = "aborted"
    cells = cells_of(dataclasses.replace(trials, status=status))
    assert (cells.trials, cells.excluded) == (16, 2)
    with pytest.raises(InputError, match="none of 18 trials"):
        cells_of(dataclasses.replace(trials, status=np.full(18, "aborted")))


def test_pooled_noise_is_what_was_drawn(drawn):
    cells = cells_of(drawn(levels=7, replicates=5, seed=4))
    floor = noise_floor(cells)
    assert cells.noise[1] == pytest.approx(0.0004, rel=0.25)
    assert floor["peak_speed"] > 0.005


def test_without_replicates_noise_is_unknown(drawn):
    cells = cells_of(drawn(levels=3, replicates=1))
    assert np.isnan(cells.noise).all()
    assert (cells.pure_error_dof == 0).all()
    assert np.isfinite(cells.covariance).all()


def test_a_cell_that_flips_stands_on_its_own_scatter():
    rng = np.random.default_rng(0)
    cells, replicates = 20, 3
    cell = np.repeat(np.arange(cells), replicates)
    residual = rng.normal(0, 0.005, (cells * replicates, 4))
    residual[:3] = [[0.08] * 4, [-0.04] * 4, [-0.04] * 4]
    count = np.full((cells, 4), replicates)
    error = pure_error(residual, cell, count, np.ones(cells, dtype=bool), np.full(cells, 8.0))
    assert error.own[0]
    assert error.own.sum() <= 2
    assert error.sd[0] == pytest.approx(0.005 * np.sqrt(2 / 3), rel=0.5)
    assert np.sqrt(error.covariance[0, 0, 0]) > 0.05
    assert np.sqrt(error.covariance[5, 0, 0]) < 0.01


def test_scatter_that_follows_frequency_is_followed():
    rng = np.random.default_rng(1)
    omega = np.repeat([4.0, 8.0, 16.0, 30.0], 10)
    cell = np.repeat(np.arange(40), 3)
    residual = rng.normal(size=(120, 4)) * (1e-3 * omega[cell])[:, None]
    residual -= np.stack([np.bincount(cell, column) / 3 for column in residual.T], axis=-1)[cell]
    error = pure_error(residual, cell, np.full((40, 4), 3), np.ones(40, dtype=bool), omega)
    found = np.sqrt(error.covariance[:, 0, 0])
    np.testing.assert_allclose(found / (1e-3 * omega), 1.0, atol=0.45)


def test_known_deviations_of_phi_are_taken_out(drawn):
    """Drawn φ are measured exactly: nearly all of them is real, and the lift scatters less for it."""
    trials = drawn(levels=7, replicates=6, seed=1, noise=0.1)
    cells = cells_of(trials)
    assert cells.phi_reliability > 0.9
    walking = cells.mean[:, Observable.lift] > 3e-3
    raw = [
        trials.lift_m[np.isclose(trials.omega_rad_s, w) & (np.abs(trials.phi - p) < 4e-3)].std(ddof=1)
        for p, w in zip(cells.phi[walking], cells.omega[walking], strict=True)
    ]
    assert np.mean(cells.sd[walking, 1]) < 0.7 * np.mean(raw)


def test_a_phi_that_is_all_sensor_noise_is_left_alone(drawn):
    trials = drawn(levels=7, seed=1, noise=1.0)
    scrambled = np.round(trials.phi * 0 + np.repeat(np.linspace(0.58, 0.633, 7), 21), 6)
    scrambled = scrambled + np.random.default_rng(0).normal(0, 6e-4, len(scrambled))
    assert cells_of(dataclasses.replace(trials, phi=scrambled)).phi_reliability < 0.35


def test_a_row_without_a_frequency_is_left_out_in_silence(recwarn):
    good, bad = (Row("t", 0.6, 0.001, omega, "SGCS", 1, 0.1, np.nan, 0.005, 0.4, 0.03, "ok") for omega in (12.0, 0.0))
    assert cells_of(from_rows([good, bad])).n.tolist() == [[1, 1, 1, 1]]
    assert [str(one.message) for one in recwarn] == []


@pytest.mark.parametrize(
    ("gait", "speed", "lift", "first", "left_out"),
    [
        ("SGCS", 0.02, 0.0, 0.002, True),
        ("SGCS", 0.02, np.nan, 0.002, True),
        ("UNIFORM", 0.02, 0.0, 0.002, False),
        ("SGCS", 0.02, 0.0, 0.035, False),
        ("SGCS", 0.2, 0.008, 0.03, False),
    ],
)
def test_the_first_step_of_a_swimmer_with_uneven_legs_says_nothing(gait, speed, lift, first, left_out):
    """Controls: even legs, a first step that held before the collapse, a walker."""
    omega, values = np.full(3, 12.0), np.tile([speed, lift, 0.1, first], (3, 1))
    assert swum_at_once([gait] * 3, omega, values).tolist() == [left_out] * 3
    trials = from_rows([Row("t", 0.6, 0.001, 12.0, gait, n, speed, np.nan, lift, 0.1, first, "ok") for n in range(3)])
    assert bool(np.isnan(cells_of(trials).mean[0, 3])) == left_out
