"""What a trial averages over: quadrature against closed forms, between trials and along the track."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.physics.averaging import (
    NODES,
    PLACES,
    STEPS,
    WEIGHTS,
    along_the_track,
    node_weights,
    predicted,
    share_between_trials,
    slope_of,
)
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Inputs, KCurve, Walker

CURVE = KCurve(np.array([0.58, 0.60, 0.62]), np.array([180.0, 200.0, 220.0]))
PLAIN, VARIED = Walker(), Walker((catalogue()["phi_nonuniformity"],))


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))
def test_polynomials_of_a_normal_variable_are_averaged_exactly(a, b, c):
    assert WEIGHTS @ (a + b * NODES**2 + c * NODES**4) == pytest.approx(a + b + 3 * c, abs=1e-9)
    assert WEIGHTS.sum() == pytest.approx(1.0)


def test_along_the_track_lift_is_the_median_step_and_peak_the_best_one():
    values = np.stack([NODES, NODES + 10, -NODES, NODES], axis=-1)
    weights = node_weights(values, WEIGHTS)
    average = np.sum(weights * values, axis=0)
    inner = NODES[np.abs(NODES) < 2]
    assert average[Observable.speed] == pytest.approx(WEIGHTS @ NODES, abs=1e-12)
    assert average[Observable.lift] == pytest.approx(10.0)
    assert average[Observable.peak_speed] == pytest.approx(inner.max())
    assert set(np.unique(weights[:, Observable.peak_speed])) == {0.0, 1.0}
    # Control: between trials both are averages.
    plain = WEIGHTS @ values
    assert plain[Observable.peak_speed] == pytest.approx(0.0, abs=1e-12)


def test_only_an_effect_along_the_track_is_averaged_over_steps():
    assert not along_the_track(PLAIN)
    assert along_the_track(VARIED)
    assert (share_between_trials(False, 1e-3, np.zeros((1, 1))) == 1.0).all()
    share = share_between_trials(True, 0.0, np.full((1, 1), 0.002))
    np.testing.assert_allclose(share[..., Observable.speed], 1 / np.sqrt(STEPS))
    np.testing.assert_allclose(share[..., Observable.first_step], 1.0)


def test_the_slope_of_k_is_that_of_a_straight_line_and_bounded_otherwise():
    phi, k = np.array([0.58, 0.60, 0.62]), np.array([180.0, 200.0, 220.0])
    assert slope_of(phi, k) == pytest.approx([1000.0] * 3)
    assert (slope_of(phi, np.full(3, 200.0)) > 0).all()
    assert slope_of(phi[:1], k[:1]) == pytest.approx([900.0])


@pytest.mark.parametrize("sigma_phi", [0.0, 0.002, 0.004])
def test_a_prediction_is_the_average_over_the_track_and_its_lift_the_median_steps(sigma_phi):
    """At (.600, ω) from walking everywhere to swimming nearly everywhere; by brute force over φ, k linear in it."""
    omega = np.array([8.0, 16.0, 20.0, 23.0, 26.0])
    here, params = Inputs(200.0, omega, 0.4, 0.6), [{"sigma_phi": sigma_phi}]
    found, plain = predicted(VARIED, here, params, CURVE), PLAIN.predict(here)
    local = 200.0 + 1000.0 * sigma_phi * np.random.default_rng(0).standard_normal(4000)[:, None]
    steps = PLAIN.predict(Inputs(local, omega, 0.4, 0.6))
    np.testing.assert_allclose(found.speed_m_s, steps.speed_m_s.mean(axis=0), atol=2e-3)
    np.testing.assert_allclose(found.first_step_m, steps.first_step_m.mean(axis=0), atol=8e-4)
    np.testing.assert_array_equal(found.lift_m, plain.lift_m)
    np.testing.assert_array_equal(found.walking, plain.walking)
    # Control: without it the switch is a cliff, and nothing is averaged where nothing varies.
    if sigma_phi:
        assert np.abs(found.speed_m_s - plain.speed_m_s).max() > 5e-3
    else:
        np.testing.assert_allclose(found.observables, plain.observables, rtol=1e-12)
    np.testing.assert_array_equal(predicted(PLAIN, here, (), CURVE).observables, plain.observables)


def test_places_along_the_track_are_those_of_a_normal_variable():
    assert PLACES[len(PLACES) // 2] == pytest.approx(0.0, abs=1e-12)
    assert (PLACES.mean(), PLACES.std()) == (pytest.approx(0.0, abs=1e-12), pytest.approx(1.0))
