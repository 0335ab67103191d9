"""The information a measurement is expected to give, against its closed-form limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.design.information import bhattacharyya, information

gaps = st.floats(0.0, 20.0)


def of(means, covariances, weights=None):
    means, covariances = np.asarray(means, dtype=float), np.asarray(covariances, dtype=float)
    return float(information(np.full(len(means), 1 / len(means)) if weights is None else weights, means, covariances))


def exactly(means, sd):
    """Mutual information of two equally likely explanations, by quadrature."""
    y = np.linspace(-60, 60, 200_001)
    each = np.array(
        [np.exp(-0.5 * ((y - m) / s) ** 2) / (s * np.sqrt(2 * np.pi)) for m, s in zip(means, sd, strict=True)]
    )
    mixture = each.mean(axis=0)
    logs = np.where(each > 0, each * np.log(np.maximum(each, 1e-300) / np.maximum(mixture, 1e-300)), 0.0)
    return float(np.trapezoid(logs, y, axis=1).mean())


def test_rivals_that_predict_alike_tell_nothing():
    assert of([[1.0, 2.0]] * 3, [np.eye(2)] * 3) == pytest.approx(0.0, abs=1e-12)


def test_rivals_far_apart_tell_all_there_is_to_know():
    weights = np.array([0.2, 0.3, 0.5])
    told = of([[0.0], [100.0], [200.0]], np.ones((3, 1, 1)), weights)
    assert told == pytest.approx(-np.sum(weights * np.log(weights)))


@given(gaps, st.floats(0.3, 3.0), st.floats(0.3, 3.0))
def test_it_is_a_bound_from_below(gap, first, second):
    told = of([[0.0], [gap]], [[[first**2]], [[second**2]]])
    assert -1e-9 <= told <= exactly([0.0, gap], [first, second]) + 1e-6


@given(gaps, gaps, st.floats(0.1, 10.0))
def test_with_the_noise_alone_it_ranks_as_hunter_and_reiner(gap, other, variance):
    """They take the place where |Δ|² is largest."""
    first, second = (of([[0.0, 0.0], [one, 0.5]], [variance * np.eye(2)] * 2) for one in (gap, other))
    assert (first - second) * (gap - other) >= -1e-12


def test_of_two_with_one_covariance_the_distance_is_an_eighth_of_buzzi_ferraris_ratio():
    gap, both = np.array([1.0, -2.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
    assert bhattacharyya(np.zeros(2), gap, both, both) == pytest.approx(gap @ np.linalg.solve(both, gap) / 8)


def test_a_vague_rival_is_told_from_a_sharp_one_that_predicts_the_same():
    assert of([[0.0], [0.0]], [[[1.0]], [[100.0]]]) > 0.2
