"""What a trial averages over: quadrature against closed forms, between trials and along the track."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.fitting.averaging import NODES, STEPS, WEIGHTS, along_the_track, node_weights, share_between_trials
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Walker

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
