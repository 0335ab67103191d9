"""Trials brought to their level's φ: what a measured deviation explains is taken out, and no more."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbot_model.data.conditions import cells_of
from sandbot_model.data.covariate import local_slope, reliability
from sandbot_model.physics.observables import Observable

KEYS = np.array([[0, 1, 2], [0, 0, 0], [0, 0, 0]])
LEVELS = np.array([0.59, 0.60, 0.62])
WALKING = np.ones(3, dtype=bool)


@given(st.floats(-50.0, 50.0), st.floats(-1.0, 1.0))
def test_a_straight_line_has_its_slope_at_every_level(slope, offset):
    mean = np.repeat(offset + slope * LEVELS[:, None], 4, axis=1)
    np.testing.assert_allclose(local_slope(mean, KEYS, LEVELS, WALKING), slope, rtol=1e-6, atol=1e-6)


def test_a_neighbour_that_swims_is_not_asked():
    mean = np.repeat(np.array([0.0, 0.2, 0.3])[:, None], 4, axis=1)
    found = local_slope(mean, KEYS, LEVELS, np.array([False, True, True]))
    np.testing.assert_allclose(found[:, 0], [0.0, 5.0, 5.0])
    assert not local_slope(mean, KEYS, LEVELS, np.array([False, True, False])).any()


def test_cells_of_another_gait_or_frequency_are_no_neighbours():
    mean = np.repeat(np.array([0.0, 0.2, 0.3])[:, None], 4, axis=1)
    for row in (1, 2):
        keys = KEYS.copy()
        keys[row] = [0, 1, 2]
        assert not local_slope(mean, keys, LEVELS, WALKING).any()


@settings(max_examples=40)
@given(st.floats(0.3, 1.0), st.integers(0, 2**16))
def test_the_share_that_is_real_is_found(share, seed):
    rng = np.random.default_rng(seed)
    expected = rng.normal(0, 1, (300, 4))
    residual = share * expected + rng.normal(0, 0.5, expected.shape)
    assert reliability(residual, expected) == pytest.approx(share, abs=0.1)


@settings(max_examples=40)
@given(st.integers(0, 2**16))
def test_a_share_that_is_not_there_is_not_claimed(seed):
    rng = np.random.default_rng(seed)
    found = reliability(rng.normal(0, 1, (300, 4)), rng.normal(0, 1, (300, 4)))
    assert found == 0.0 or 0.05 < found < 0.2  # two standard errors are passed once in forty draws


@given(st.integers(-300, 300).map(lambda percent: percent / 100))
def test_a_share_is_a_share(share):
    expected = np.linspace(-1.0, 1.0, 40)[:, None] * np.ones(4)
    assert reliability(share * expected, expected) == pytest.approx(np.clip(share, 0.0, 1.0), abs=1e-9)


def test_nothing_measured_nothing_claimed():
    assert reliability(np.full((5, 4), np.nan), np.ones((5, 4))) == 0.0
    assert reliability(np.ones((5, 4)), np.zeros((5, 4))) == 0.0


def test_known_deviations_of_phi_are_taken_out(drawn):
    """Drawn φ are measured exactly, so the lift scatters less about their influence."""
    trials = drawn(levels=7, replicates=6, seed=1, noise=0.1)
    cells = cells_of(trials)
    walking = cells.mean[:, Observable.lift] > 3e-3
    raw = [
        trials.lift_m[np.isclose(trials.omega_rad_s, w) & (np.abs(trials.phi - p) < 4e-3)].std(ddof=1)
        for p, w in zip(cells.phi[walking], cells.omega[walking], strict=True)
    ]
    assert np.mean(cells.sd[walking, 1]) < 0.7 * np.mean(raw)


def test_a_phi_that_is_all_sensor_noise_is_left_alone(drawn):
    trials = drawn(levels=7, seed=1, noise=1.0)
    aimed = np.repeat(np.linspace(0.58, 0.633, 7), 21)
    scrambled = aimed + np.random.default_rng(0).normal(0, 6e-4, len(aimed))
    corrected, as_measured = (cells_of(dataclasses.replace(trials, phi=phi)).sd for phi in (scrambled, aimed))
    np.testing.assert_allclose(corrected, as_measured, rtol=1e-9)
