"""The likelihood: its derivatives, what counts in it, and how a cell beside the switch weighs less."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.points import ArrayChains
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

EFFECTS = catalogue()
THETA, SLOPE = np.array([[0.4, 0.02]]), np.full((1, 3), 800.0)
HARD = np.log([[205.0, 215.0, 235.0]])


@pytest.fixture
def problem(drawn):
    return Problem(model_of("simple", (), EFFECTS), cells_of(drawn(levels=3, omega=(6, 12))))


@pytest.mark.parametrize("effects", [(), ("disturbed_ground",), ("leg_slip", "exact_leg_arc"), ("motor_saturation",)])
def test_the_jacobian_is_that_of_finite_differences(drawn, effects):
    cells = cells_of(drawn(levels=3, omega=(6, 12)))
    problem = Problem(model_of("simple", effects, EFFECTS), cells)
    theta = np.array([[one.start for one in problem.model.parameters]])
    ln_k = np.log([[190.0, 215.0, 235.0]])
    slope = np.full((1, 3), 800.0)
    state = problem.states(theta, ln_k, slope)
    jacobian = full_jacobian(problem, state, switches=True)[0]
    for column in range(theta.shape[1] + 3):
        sides = []
        for sign in (1, -1):
            t, k = theta.copy(), ln_k.copy()
            target, index = (t, column) if column < theta.shape[1] else (k, column - theta.shape[1])
            step = 1e-5 * max(abs(target[0, index]), 1e-3)
            target[0, index] += sign * step
            moved = problem.states(t, k, slope)
            sides.append(np.einsum("cij,cj->ci", state.whiten[0], moved.predicted[0]) / (2 * step))
        np.testing.assert_allclose(jacobian[:, column], (sides[0] - sides[1]).ravel(), rtol=2e-3, atol=2e-2)


def test_a_formula_for_the_spread_of_phi_is_averaged_along_the_track_as_the_catalogue_s_is(drawn):
    cells, typed = cells_of(drawn(levels=3, omega=(6, 12))), "uneven: strength: sigma -> hypot(sigma, s); s [1] in 0..1"
    effects = {**EFFECTS, "uneven": formula_effect(typed)}
    theta = np.array([[0.4, 0.02, 0.004]])
    own, same, without = (
        Problem(model_of("simple", names, effects), cells).states(theta[:, : 2 + len(names)], HARD, SLOPE).predicted
        for names in (("uneven",), ("phi_nonuniformity",), ())
    )
    np.testing.assert_allclose(own, same, rtol=1e-12)
    assert not np.allclose(own, without, rtol=1e-4)


def test_away_from_the_switch_the_deviance_is_chi_squared_of_the_pure_error(problem):
    state = problem.states(THETA, HARD, SLOPE)
    assert state.footing.walking.all()
    gap = problem.cells.mean - state.predicted[0]
    chi2 = sum(g @ np.linalg.solve(c, g) for g, c in zip(gap, problem.covariance, strict=True))
    assert state.deviance[0] == pytest.approx(chi2)
    assert problem.widening(state.covariance[0]) == pytest.approx(1.0)


def test_a_cell_on_the_switch_weighs_less_than_one_away_from_it(problem):
    """Where some of the bed's φ walk and some swim, the mean says little and the variance says so."""
    critical = np.log(np.linspace(160.0, 190.0, 61))[:, None] + np.zeros(3)
    states = problem.states(np.repeat(THETA, 61, axis=0), critical, np.full((61, 3), 800.0))
    mixed = states.footing.walking.any(axis=2) & ~states.footing.walking.all(axis=2)
    assert mixed.any()
    wider = states.covariance[..., Observable.speed, Observable.speed] > problem.covariance[:, 0, 0] * 1.000001
    assert (wider <= mixed).all()
    assert wider.any()


def test_what_was_not_measured_does_not_count(problem):
    problem.cells.mean[0, Observable.lift] = np.nan
    fewer = Problem(problem.model, problem.cells)
    moved = fewer.states(THETA, HARD, SLOPE)
    assert not fewer.measured[0, Observable.lift]
    assert moved.residual[0, 0, Observable.lift] == 0.0
    assert np.isfinite(moved.deviance).all()


def two_nuisances(slope, draw):
    """Two nuisances, one of which moves k, about values that are not 0."""
    by_ln_k = np.stack([draw.uniform(size=len(slope)), np.zeros(len(slope))], axis=-1)
    return Nuisances(
        ("a", "b"), np.array([1.0, 2.0]), slope, np.full(len(slope), 0.005), np.array([0.02, 0.0]), by_ln_k
    )


@pytest.mark.parametrize("recorded", [True, False])
@pytest.mark.parametrize("effects", [("stance_overlap",), ("phi_nonuniformity",), ("dilation", "leg_slip")])
@pytest.mark.parametrize("shares", [True, False])
def test_each_cell_at_parameters_of_its_own_is_that_cell_of_a_whole_evaluation(drawn, effects, recorded, shares):
    model = model_of("simple", effects, EFFECTS)
    cells = cells_of(drawn(levels=3, omega=(6, 12, 24)))
    draw, count = np.random.default_rng(2), len(cells)
    slope = draw.normal(0, 1e-3, (count, 4, 2))
    nuisances = two_nuisances(slope, draw) if shares else None
    problem = Problem(model, cells, nuisances)
    if not recorded:
        problem.cell_means.chains = ArrayChains(model)
    theta = np.array([one.start for one in model.parameters]) * draw.uniform(0.95, 1.05, (count, len(model.parameters)))
    ln_k = np.log([175.0, 195.0, 220.0]) + draw.normal(0, 0.02, (count, 3))
    shared = draw.normal(0, 1, (count, 2)) if shares else None
    found = problem.cell_by_cell(theta, ln_k, SLOPE, shared)
    whole, own = problem.states(theta, ln_k, SLOPE, shared), (np.arange(count),) * 2
    np.testing.assert_array_equal(found.predicted, whole.predicted[own])
    np.testing.assert_array_equal(found.widening, problem.widening(whole.covariance[own]))
    np.testing.assert_allclose(found.deviance, whole.cell_deviance[own], rtol=1e-12)
    np.testing.assert_array_equal(found.walks, whole.footing.walking[own].mean(axis=1) > 0.5)
    assert 0 < found.walks.sum() < count
