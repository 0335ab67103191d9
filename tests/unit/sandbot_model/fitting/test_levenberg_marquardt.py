"""Descents: downhill to where the gradient is nothing, inside the bounds; and projection out of a fit's tangent."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.jacobian import full_jacobian, project_out, tangent_basis
from sandbot_model.fitting.levenberg_marquardt import PATIENCE, bounds, descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of


@pytest.fixture(scope="module")
def problem(drawn):
    return Problem(model_of("simple", (), catalogue()), cells_of(drawn(levels=3, omega=(6, 10, 14))))


@pytest.fixture(scope="module")
def begin(problem):
    theta = np.array([[0.35, 0.02], [0.6, 0.02]])
    return problem.states(theta, np.log([[200.0, 220.0, 240.0]] * 2), np.full((2, 3), 800.0))


def test_it_ends_lower_where_the_gradient_is_nothing(problem, begin):
    end = descend(problem, begin)
    assert (end.deviance < begin.deviance).all()
    best = end.take(np.argsort(end.deviance)[:1])
    jacobian, residual = full_jacobian(problem, best)[0], best.all_residuals[0]
    slope = np.abs(jacobian.T @ residual) / np.linalg.norm(jacobian, axis=0).clip(1e-9)
    assert slope.max() < 0.3


def test_no_step_is_no_change(problem, begin):
    assert (descend(problem, begin, 0).theta == begin.theta).all()


def test_what_comes_no_nearer_to_a_hopeless_deviance_is_given_up_and_what_does_is_not(problem, begin, monkeypatch):
    end = descend(problem, begin)
    reached = float(end.deviance.min())
    assert descend(problem, begin, hopeless=reached + 10).deviance.min() == reached
    tried = []
    monkeypatch.setattr(
        Problem, "states", lambda self, *of, states=Problem.states: tried.append(1) or states(self, *of)
    )
    # Where it has come to there is nothing to gain; a tenth of that would do.
    given_up = descend(problem, begin.where(np.ones(2, dtype=bool), end), hopeless=0.1 * reached)
    assert len(tried) <= PATIENCE
    np.testing.assert_allclose(given_up.deviance, end.deviance, atol=0.1)


def test_parameters_stay_inside_what_may_be_searched(problem, begin):
    low, high = bounds(problem)
    end = descend(problem, problem.states(np.stack([low, high]), begin.ln_k, begin.slope))
    assert ((end.theta >= low) & (end.theta <= high)).all()


def test_what_the_parameters_absorb_is_projected_out_and_the_rest_stays(problem, begin):
    state = begin.take(np.array([0]))
    basis, jacobian = tangent_basis(problem, state), full_jacobian(problem, state)[0]
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-9)
    absorbed = jacobian @ np.arange(1.0, jacobian.shape[1] + 1)
    assert np.linalg.norm(project_out(absorbed, basis)) < 1e-6 * np.linalg.norm(absorbed)
    rest = project_out(np.random.default_rng(0).normal(size=len(jacobian)), basis)
    np.testing.assert_allclose(project_out(rest, basis), rest)
