"""Standard errors and their propagation: closed forms of a linear model, what is not determined, and a switch."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.fitting.uncertainty import propagated, standard_errors

RNG = np.random.default_rng(0)


def test_of_a_linear_model_they_are_the_textbooks():
    jacobian = RNG.normal(size=(20, 3))
    stderr, covariance = standard_errors(jacobian)
    np.testing.assert_allclose(covariance, np.linalg.inv(jacobian.T @ jacobian), rtol=1e-9)
    np.testing.assert_allclose(stderr, np.sqrt(np.diag(covariance)))


def test_what_the_data_do_not_determine_has_no_error_and_no_share_in_others():
    jacobian = np.column_stack([RNG.normal(size=(20, 2)), np.zeros(20)])
    stderr, covariance = standard_errors(jacobian)
    assert np.isnan(stderr[2])
    assert not covariance[2].any()
    np.testing.assert_allclose(stderr[:2], standard_errors(jacobian[:, :2])[0])


@given(st.integers(0, 99))
def test_a_linear_prediction_has_the_error_of_error_propagation(seed):
    rng = np.random.default_rng(seed)
    root, slope = rng.normal(size=(3, 3)), rng.normal(size=(5, 3))
    covariance = root @ root.T
    found = propagated(lambda unknowns: slope @ unknowns, rng.normal(size=3), covariance)
    np.testing.assert_allclose(found, np.sqrt(np.einsum("pi,ij,pj->p", slope, covariance, slope)), rtol=1e-6)


def test_a_switch_within_reach_shows_and_one_far_away_does_not():
    def walks(unknowns):
        return np.where(unknowns > 0.0, 1.0, 0.0)

    assert propagated(walks, np.array([0.05]), np.eye(1) * 0.1**2) == pytest.approx([0.5])
    assert propagated(walks, np.array([0.5]), np.eye(1) * 0.1**2) == pytest.approx([0.0])
    assert propagated(walks, np.array([0.05]), np.zeros((1, 1))) == pytest.approx(0.0)
