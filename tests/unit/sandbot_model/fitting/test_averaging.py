"""What a trial averages over: quadrature against closed forms, between trials and along the track."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.fitting.averaging import NODES, STEPS, WEIGHTS, along_the_track, node_average, share_between_trials
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Inputs, Walker

PLAIN, VARIED = Walker(), Walker((catalogue()["phi_nonuniformity"],))


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))
def test_polynomials_of_a_normal_variable_are_averaged_exactly(a, b, c):
    values = (a + b * NODES**2 + c * NODES**4)[:, None] * np.ones(4)
    average, weights = node_average(values, along_the_track=False)
    assert average == pytest.approx(a + b + 3 * c, abs=1e-9)
    assert weights.sum(axis=0) == pytest.approx(1.0)


def test_along_the_track_lift_is_the_median_step_and_peak_the_best_one():
    values = np.stack([NODES, NODES + 10, -NODES, NODES], axis=-1)
    average, weights = node_average(values, along_the_track=True)
    inner = NODES[np.abs(NODES) < 2]
    assert average[Observable.speed] == pytest.approx(WEIGHTS @ NODES, abs=1e-12)
    assert average[Observable.lift] == pytest.approx(10.0)
    assert average[Observable.peak_speed] == pytest.approx(inner.max())
    assert set(np.unique(weights[:, Observable.peak_speed])) == {0.0, 1.0}
    # Control: between trials both are averages.
    assert node_average(values, along_the_track=False)[0][Observable.peak_speed] == pytest.approx(0.0, abs=1e-12)


def test_only_an_effect_along_the_track_is_averaged_over_steps():
    assert not along_the_track(PLAIN)
    assert along_the_track(VARIED)
    inputs = Inputs(np.full((1, 1, 1), 200.0), 8.0, 0.4, 0.61)
    assert (share_between_trials(PLAIN, 1e-3, inputs, []) == 1.0).all()
    share = share_between_trials(VARIED, 0.0, inputs, [{"sigma_phi": np.full((1, 1, 1), 0.002)}])
    np.testing.assert_allclose(share[..., Observable.speed], 1 / np.sqrt(STEPS))
    np.testing.assert_allclose(share[..., Observable.first_step], 1.0)
