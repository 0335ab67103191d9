"""The global minimum: against a dense scan, from a warm start, and beside a model that nests in it."""

import math

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting import global_minimum
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.global_minimum import HOPELESS, SLACK, best_state, slope_of, solve
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.starts import profile
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of

EFFECTS = catalogue()


@pytest.mark.slow
def test_the_optimum_is_global(drawn):
    """Against a dense scan of Δt with every k profiled on a fine grid."""
    cells = cells_of(drawn(seed=2, levels=4))
    model = model_of("simple", (), EFFECTS)
    found = fit(model, cells)
    problem = Problem(model, cells)
    theta = np.stack([np.geomspace(0.05, 2.0, 120), np.full(120, found.parameters["v_swim_m_s"].value)], axis=-1)
    slope = slope_of(cells.level_phi, found.k_n_per_m)
    _, ln_k = profile(problem, theta, slope, found.k_n_per_m, np.geomspace(100, 500, 600))
    slopes = np.array([slope_of(cells.level_phi, k) for k in np.exp(ln_k)])
    assert found.deviance <= problem.states(theta, ln_k, slopes).deviance.min() + 1.0


def test_a_larger_model_is_never_worse_than_the_one_it_starts_from(drawn):
    cells = cells_of(drawn(seed=3, levels=3))
    base = fit(model_of("simple", (), EFFECTS), cells)
    for nearby in (True, False):
        point = solve((model_of("simple", ("leg_slip",), EFFECTS), cells, base.warm_start, nearby, math.inf))
        problem = Problem(model_of("simple", ("leg_slip",), EFFECTS), cells)
        larger = problem.states(point.theta[None], point.ln_k[None], point.slope[None])
        assert larger.deviance[0] <= base.deviance + 1.0


@pytest.mark.parametrize("hopeless", [False, True])
def test_no_jumps_are_tried_far_above_the_best_of_other_models(drawn, monkeypatch, hopeless):
    """It ends in the same valley all the same, and never above the model it starts from."""
    jumped = []
    monkeypatch.setattr(global_minimum, "_hopped", lambda _, states: jumped.append(states) or states)
    cells = cells_of(drawn(seed=3, levels=3))
    base, model = fit(model_of("simple", (), EFFECTS), cells), model_of("simple", ("crater_refill",), EFFECTS)
    least = (base.deviance / 2 - SLACK) / HOPELESS if hopeless else math.inf
    point = solve((model, cells, base.warm_start, False, least))
    assert bool(jumped) != hopeless
    larger = Problem(model, cells).states(point.theta[None], point.ln_k[None], point.slope[None])
    assert larger.deviance[0] <= base.deviance + 1.0


def test_it_is_the_same_every_time_and_no_neighbour_is_lower(drawn):
    problem = Problem(model_of("simple", (), EFFECTS), cells_of(drawn(seed=4, levels=3)))
    found, again = best_state(problem), best_state(problem)
    assert (found.theta == again.theta).all()
    moves = np.random.default_rng(0).normal(0.0, 2e-3, (50, found.ln_k.shape[1]))
    around = problem.states(np.repeat(found.theta, 50, axis=0), found.ln_k + moves, found.slope[0])
    assert around.deviance.min() > found.deviance[0] - 0.05


def test_the_slope_of_k_is_that_of_a_straight_line_and_bounded_otherwise():
    phi, k = np.array([0.58, 0.60, 0.62]), np.array([180.0, 200.0, 220.0])
    assert slope_of(phi, k) == pytest.approx([1000.0] * 3)
    assert (slope_of(phi, np.full(3, 200.0)) > 0).all()
    assert slope_of(phi[:1], k[:1]) == pytest.approx([900.0])
