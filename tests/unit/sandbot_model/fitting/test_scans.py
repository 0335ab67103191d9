"""Scans: a k in a wrong valley is found its way out, one in the right valley stays."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.scans import bounded, k_response, scan_bed, scan_k, scan_theta
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of


@pytest.fixture(scope="module")
def base(drawn):
    return fit(model_of("simple", (), catalogue()), cells_of(drawn(seed=2, levels=3)))


def test_a_k_that_swims_is_brought_back_and_a_fitted_one_left_alone(base):
    problem, state = base.problem, base.state
    assert scan_k(problem, state) is state
    soft = state.ln_k.copy()
    soft[0, -1] += np.log(0.75)
    swimming = problem.states(state.theta, soft, state.slope)
    back = scan_k(problem, swimming)
    assert back.deviance[0] < 0.2 * swimming.deviance[0]
    assert np.exp(back.ln_k[0, -1]) == pytest.approx(base.k_n_per_m[-1], rel=0.06)


def test_a_parameter_far_off_is_brought_nearer_and_a_fitted_one_left_alone(base):
    problem, state = base.problem, base.state
    assert scan_theta(problem, state) is state
    off = problem.states(state.theta * [1.4, 1.0], state.ln_k, state.slope)
    assert scan_theta(problem, off).deviance[0] < off.deviance[0]


def test_offsets_far_off_are_brought_nearer_all_at_once_and_none_left_alone(base):
    level = np.eye(3)[base.cells.level]
    free = Nuisances(("ln_k",) * 3, np.full(3, 0.01), np.zeros((len(level), 4, 3)), 0 * level[:, 0], np.zeros(3), level)
    problem = Problem(base.model, base.cells, free)
    state = problem.states(base.state.theta, base.state.ln_k, base.state.slope)
    assert scan_bed(problem, state) is state
    assert scan_bed(base.problem, base.state) is base.state
    off = problem.states(base.state.theta, base.state.ln_k, base.state.slope, np.array([[0.02, -0.02, 0.0]]))
    np.testing.assert_allclose(problem.shared(scan_bed(problem, off)), 0.0, atol=1e-12)


def test_few_of_the_cells_never_deviate_more_than_all_and_are_of_every_level(base):
    problem, draw = base.problem, np.random.default_rng(0)
    theta = base.state.theta * draw.uniform(0.7, 1.4, (20, 1))
    ln_k = base.state.ln_k + draw.normal(0.0, 0.1, (20, 3))
    few, every = (one.states(theta, ln_k, base.state.slope).deviance for one in (problem.subset, problem))
    assert (few <= every).all()
    assert set(problem.subset.cells.level) == {0, 1, 2}
    assert len(problem.subset.cells) < len(problem.cells) / 2


def test_k_responds_so_that_its_cells_change_least(base):
    problem, state = base.problem, base.state
    response = k_response(problem, state)
    assert response.shape == (2, 3)
    step = 0.02
    theta = state.theta + np.array([step, 0.0])
    with_k, without = (
        problem.states(theta, state.ln_k + share * step * response[0], state.slope).deviance[0] for share in (1.0, 0.0)
    )
    assert with_k < without
    assert (bounded(np.array([-3.0, 0.5, 3.0])) == [-1.0, 0.5, 1.0]).all()
