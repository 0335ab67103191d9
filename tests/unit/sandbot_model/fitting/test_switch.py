"""Beside a switch: the share of trials that walks, or walks another way, against where the chain itself switches."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.jacobian import cell_jacobian
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.operations import CompiledChains
from sandbot_model.fitting.points import ArrayChains, Conditions, Points
from sandbot_model.fitting.switch import share_of_nodes, switches_of
from sandbot_model.physics.averaging import NODES, WEIGHTS
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.gait import clock
from sandbot_model.physics.model import model_of
from sandbot_model.physics.tape import record
from sandbot_model.physics.walking import KCurve

SIGMA = 0.005
"""σ_k/k."""
DISTURBED = {"disturbed_ground.k_l_n_per_m": 175.0, "disturbed_ground.s_c": 0.95}


def one_cell(effects, k, omega, **held):
    """A cell at each k ``(cells,)``: the chain on arrays and as operations, where they are evaluated, and the model."""
    model = model_of("simple", effects, catalogue())
    theta = np.array([[{"delta_t_s": 0.4, "v_swim_m_s": 0.02, **held}[name] for name in model.names]])
    turns = clock(["UNIFORM"] * len(k))
    at = Conditions.of(model.walker, np.full(len(k), omega), np.full(len(k), 0.6), turns)
    points = Points(
        theta, at, (k[:, None] * (1 + SIGMA * NODES))[None], KCurve(np.array([0.6]), np.array([[200.0]]), 3)
    )
    return ArrayChains(model), CompiledChains(model, record(model.walker)), points, model


def shares(chains, points, model):
    footing = chains.footing(points)
    found = switches_of(chains, points, footing, np.array([[True]]), remembers=model.walker.remembers)
    return share_of_nodes(found, points.shape)[0], footing


def beyond(footing):
    """Whether nodes ``(cells, nodes)`` walk; where all do, whether they stand where the shallower half does."""
    walking, depth = footing.walking[0], footing.depth[0]
    return depth < 0.5 * (depth.min() + depth.max()) if walking.all() else walking


def switch_of(model, points, low, high):
    """k at which the chain switches between ``low`` and ``high``, by bisection."""
    for _ in range(40):
        middle = 0.5 * (low + high)
        k = np.array([low, middle, high])
        some = replace(points, k=k[None, None], at=points.at.some(np.array([0]), np.array([0])))
        low, high = (low, middle) if beyond(ArrayChains(model).footing(some))[0, 1] else (middle, high)
    return middle


@pytest.mark.parametrize(
    ("effects", "omega", "low", "high", "held"),
    [
        ((), 12.0, 170.0, 200.0, {}),
        (("disturbed_ground",), 12.0, 190.0, 205.0, DISTURBED),
        (("disturbed_ground",), 24.0, 214.0, 225.0, DISTURBED),
        # Here legs walk on both sides: in what they disturbed, and beyond it.
        (("disturbed_ground",), 4.0, 182.0, 190.0, DISTURBED),
    ],
)
def test_the_share_beyond_a_switch_is_that_of_the_normal_distribution(effects, omega, low, high, held):
    *_, points, model = one_cell(effects, np.array([200.0]), omega, **held)
    at = switch_of(model, points, low, high)
    away = np.linspace(-2.5, 2.5, 41)
    k = at / (1 + SIGMA * away)  # so that the switch is at node ``away``
    arrays, compiled, points, model = one_cell(effects, k, omega, **held)
    for chains in (arrays, compiled):
        share, footing = shares(chains, points, model)
        found = np.sum(share * beyond(footing), axis=1)
        assert found == pytest.approx(ndtr(-away), abs=0.03)
        np.testing.assert_allclose(share.sum(axis=1), 1.0)
        # Control: the nodes alone know it to a quarter.
        assert np.abs(np.sum(WEIGHTS * beyond(footing), axis=1) - ndtr(-away)).max() > 0.2


def test_away_from_a_switch_nodes_keep_their_weights():
    for k in (120.0, 260.0):
        arrays, compiled, points, model = one_cell(("disturbed_ground",), np.array([k]), 12.0, **DISTURBED)
        for chains in (arrays, compiled):
            np.testing.assert_array_equal(shares(chains, points, model)[0], WEIGHTS[None])


@settings(max_examples=40, deadline=None)
@given(st.floats(150.0, 230.0), st.floats(2.0, 28.0))
def test_shares_are_shares_and_agree_on_arrays_and_as_operations(k, omega):
    arrays, compiled, points, model = one_cell(("disturbed_ground",), np.array([k]), omega, **DISTURBED)
    mine, its = shares(arrays, points, model)[0], shares(compiled, points, model)[0]
    np.testing.assert_allclose(mine, its, atol=1e-6)
    assert (mine >= 0).all()
    assert mine.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("effects", [(), ("disturbed_ground",)])
def test_slopes_follow_a_switch(drawn, effects):
    """Analytic slopes of what is predicted, beside finite differences, in the cells that are mixed."""
    cells = replace(cells_of(drawn(effects, seed=2, levels=7)), phi_scatter=1e-3)
    found = fit(model_of("simple", effects, catalogue()), cells)
    problem, point = Problem(found.model, cells), found.point
    state = problem.states(point.theta[None], point.ln_k[None], point.slope[None])
    slopes = cell_jacobian(problem, state, switches=True)[0]
    mixed = problem.widening(state.covariance[0]) > 1.25
    assert mixed.sum() >= 2

    def predicted(index, step):
        theta, ln_k = point.theta.copy(), point.ln_k.copy()
        if index < len(theta):
            theta[index] += step
        else:
            ln_k += step
        return problem.states(theta[None], ln_k[None], point.slope[None]).predicted[0]

    for index in range(len(point.theta) + 1):
        step = 1e-6 * (max(abs(point.theta[index]), 1e-3) if index < len(point.theta) else 1.0)
        by = (predicted(index, step) - predicted(index, -step)) / (2 * step)
        whitened = np.einsum("cij,cj->ci", state.whiten[0], np.where(problem.measured, by, 0.0))
        largest = np.abs(whitened).max()
        np.testing.assert_allclose(slopes[mixed, :, index], whitened[mixed], rtol=0.02, atol=1e-3 * largest + 1e-9)


def test_a_collapse_does_not_jump_as_k_moves_it_over_the_nodes(drawn, monkeypatch):
    cells = replace(cells_of(drawn(("disturbed_ground",), seed=2, levels=7)), phi_scatter=1e-3)
    found = fit(model_of("simple", ("disturbed_ground",), catalogue()), cells)
    point, steps = found.point, np.linspace(-0.01, 0.01, 401)
    theta, ln_k = np.repeat(point.theta[None], len(steps), axis=0), point.ln_k + steps[:, None]

    def largest_jump(cell):
        speed = Problem(found.model, cells).states(theta, ln_k, point.slope[None]).predicted[:, cell, 0]
        return np.abs(np.diff(speed)).max() / np.ptp(speed)

    collapse = int(np.flatnonzero((cells.omega > 20) & (cells.mean[:, 0] > 0.2))[0])
    assert largest_jump(collapse) < 0.1
    # Control: by the weights of the nodes alone it does.
    evaluated = CompiledChains.footing_and_values
    monkeypatch.setattr(
        CompiledChains, "footing_and_values", lambda *of: (*(found := evaluated(*of))[:2], found[2] * 0 + WEIGHTS)
    )
    assert largest_jump(collapse) > 0.4
