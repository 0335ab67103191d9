"""Standard errors and their propagation: closed forms of a linear model, what is not determined, and a switch."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.levenberg_marquardt import bounds
from sandbot_model.fitting.uncertainty import change, principal_steps, standard_errors
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of

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


@pytest.mark.parametrize(("unit", "noise"), [(1.0, 0.0), (1e6, 0.0), (1e-6, 2e-4)])
def test_what_is_known_only_together_has_no_error_of_its_own(unit, noise):
    """y = (a + b) x + c z, whatever the unit of b and how rough its derivative. Control: b that differs by 1 %."""
    x, z = RNG.normal(size=(2, 40))
    rough = noise * RNG.normal(size=40)
    stderr, covariance = standard_errors(np.column_stack([x, unit * (x + rough), z]))
    sum_and_c, expected = standard_errors(np.column_stack([x, z]))
    assert np.isinf(stderr[:2]).all()
    assert stderr[2] == pytest.approx(sum_and_c[1], rel=1e-3)
    # A prediction from the sum is as well known as ever.
    assert covariance[:2, :2].sum() > 0
    slope = np.array([1.0, unit, 0.0])
    assert slope @ covariance @ slope == pytest.approx(expected[0, 0], rel=1e-2)
    differs = standard_errors(np.column_stack([x, unit * (x + 0.01 * RNG.normal(size=40)), z]))[0]
    assert np.isfinite(differs).all()


def test_a_prior_determines_what_the_data_leave_open():
    """As an offset of the bed beside k: a row of its own, however weak beside the data."""
    x = np.ones(40) / 1e-3
    stderr, _ = standard_errors(np.vstack([np.column_stack([x, x]), [0.0, 1 / 0.05]]))
    assert stderr == pytest.approx([0.05, 0.05], rel=1e-3)


WHOLE = (1.0, 1.0)


def summed(predict, unknowns, covariance, near=WHOLE, far=WHOLE):
    """Standard deviation of a prediction."""
    changes = [change(predict, unknowns, step, near, far) for step in principal_steps(covariance)]
    return np.sqrt(np.sum(np.square(changes), axis=0))


@given(st.integers(0, 99), st.sampled_from([WHOLE, (0.25, 1.0), (0.0, 1.0), (1.0, 0.125)]))
def test_a_linear_prediction_has_the_error_of_error_propagation_from_any_part_of_a_step(seed, near):
    rng = np.random.default_rng(seed)
    root, slope = rng.normal(size=(3, 3)), rng.normal(size=(5, 3))
    covariance = root @ root.T
    found = summed(lambda unknowns: (slope @ unknowns, True), rng.normal(size=3), covariance, near)
    np.testing.assert_allclose(found, np.sqrt(np.einsum("pi,ij,pj->p", slope, covariance, slope)), rtol=1e-6)


def test_a_switch_within_reach_shows_and_one_far_away_does_not():
    def walks(unknowns):
        on = unknowns[0] > 0.0
        return np.where(on, 1.0, np.zeros(1)), on

    covariance = np.eye(1) * 0.1**2
    assert summed(walks, np.array([0.05]), covariance) == pytest.approx([0.5])
    # From a short step it is not extrapolated, and beyond reach it does not count.
    assert summed(walks, np.array([0.01]), covariance, near=(0.25, 0.25)) == pytest.approx([0.5])
    assert summed(walks, np.array([0.05]), covariance, (0.25, 0.25), far=(0.25, 0.25)) == pytest.approx([0.0])
    assert summed(walks, np.array([0.5]), covariance) == pytest.approx([0.0])


def test_what_is_held_does_not_move_by_a_rounding_error():
    root = RNG.normal(size=(4, 4))
    covariance = root @ root.T
    covariance[1] = covariance[:, 1] = 0.0
    steps = principal_steps(covariance)
    assert steps.shape == (3, 4)
    assert not steps[:, 1].any()
    np.testing.assert_allclose(steps.T @ steps, covariance, atol=1e-9)
    assert principal_steps(np.zeros((2, 2))).shape == (0, 2)


BOOST = "boost: strength: k*(1 + a*(ω/12 - 1)); a [1] in -1..1"
"""README's own effect: k, a and Δt make one long curved valley."""


@pytest.fixture(scope="module", params=["boost", "depth_nonlinearity", "stance_overlap"])
def valley(request, drawn):
    """A fit whose parameters are known badly, though its predictions are not; stance_overlap: without a valley."""
    model = model_of("simple", (request.param,), {**catalogue(), "boost": formula_effect(BOOST)})
    return fit(model, cells_of(drawn(levels=3, omega=(4, 8, 12, 16), seed=2)))


def bootstrap_sd(found, phi, omega, draws=20):
    """Standard deviation of the predicted speed [m/s] over refits to cell means drawn about the fit."""
    cells, rng, speeds = found.cells, np.random.default_rng(1), []
    root = np.linalg.cholesky(found.problem.covariance)
    for _ in range(draws):
        mean = found.predicted + np.einsum("cij,cj->ci", root, rng.normal(size=found.predicted.shape))
        other = replace(cells, mean=np.where(found.problem.measured, mean, np.nan))
        speeds.append(fit(found.model, other, found.warm_start).predict(phi, omega).speed_m_s)
    return np.std(speeds, axis=0)


def test_a_prediction_is_as_uncertain_as_by_a_bootstrap_by_derivatives_and_by_a_sample(valley):
    phi, omega = valley.level_phi[:, None], np.array([5.0, 10.0, 15.0])
    assert not valley.predict(phi[0], omega).walking.any()
    assert valley.predict(phi[1:], omega).walking.all()
    expected = bootstrap_sd(valley, phi, omega)
    sampled = with_sampled_errors(valley)
    for found in (valley, sampled):
        ratio = found.uncertainty(phi, omega)[1:, :, 0] / expected[1:]
        assert ((ratio > 0.55) & (ratio < 1.8)).all()
    assert sampled.sample is not None
    # At the lowest φ it may also walk at 5 rad/s, and swims well within what is known at 15.
    near, _, away = sampled.uncertainty(phi[0], omega)[:, 0]
    assert near > 1.5 * away


def test_a_step_ends_at_a_bound_as_a_whole(valley):
    """Clipping one unknown would part it from those that make up for it."""
    at, low, high = valley.model.names.index("delta_t_s"), *bounds(valley.problem)
    theta = valley.point.theta.copy()
    theta[at] = high[at]
    found = replace(valley, point=replace(valley.point, theta=theta))
    met, model = [], replace(found.model)
    vars(model)["inputs"] = lambda theta, *others: met.append(theta) or valley.model.inputs(theta, *others)
    found = replace(found, model=model)
    assert np.isfinite(found.uncertainty(0.6, 10.0)).all()
    assert len(met) > len(theta)
    assert all(((theta >= low - 1e-12) & (theta <= high + 1e-12)).all() for theta in met)
