"""The global minimum: against a dense scan, from a warm start, and beside a model that nests in it."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.nuisances_about import nuisances_for
from sandbot_model.fitting import global_minimum
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.global_minimum import (
    best_state,
    nearby_state,
    solve,
    solve_first,
    solve_from,
    solve_further,
    solve_jumping,
    solve_near,
    worth_jumps,
)
from sandbot_model.fitting.levenberg_marquardt import descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.starts import profile
from sandbot_model.physics.averaging import slope_of
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
    model = model_of("simple", ("leg_slip",), EFFECTS)
    for point in (solve((model, cells, base.warm_start)), solve_near((model, cells, (base.warm_start,), None))):
        larger = Problem(model, cells).states(point.theta[None], point.ln_k[None], point.slope[None])
        assert larger.deviance[0] <= base.deviance + 1.0


@pytest.mark.parametrize("name", ["stance_overlap", "crater_refill"])
def test_the_parts_of_a_search_come_to_where_all_of_it_does(drawn, name):
    cells = cells_of(drawn(seed=3, levels=3))
    near = fit(model_of("simple", (), EFFECTS), cells).warm_start
    model = model_of("simple", (name,), EFFECTS)
    first = solve_first((model, cells, near))
    further = solve_further((model, cells, near, first.point))
    assert further.deviance <= near.deviance + 1.0
    jumping = solve_jumping((model, cells, further.point))
    assert jumping.deviance <= further.deviance
    at_once = fitted_at(model, cells, solve((model, cells, near)))
    last = jumping if worth_jumps(model, cells, further.deviance) else further
    assert last.deviance == pytest.approx(at_once.deviance, abs=0.1)
    assert worth_jumps(model, cells, further.deviance) == (name == "crater_refill")


def test_it_is_the_same_every_time_and_no_neighbour_is_lower(drawn):
    problem = Problem(model_of("simple", (), EFFECTS), cells_of(drawn(seed=4, levels=3)))
    found, again = best_state(problem), best_state(problem)
    assert (found.theta == again.theta).all()
    moves = np.random.default_rng(0).normal(0.0, 2e-3, (50, found.ln_k.shape[1]))
    around = problem.states(np.repeat(found.theta, 50, axis=0), found.ln_k + moves, found.slope[0])
    assert around.deviance.min() > found.deviance[0] - 0.05


def test_where_data_do_not_mind_a_parameter_it_stays_in_its_plausible_range(drawn):
    """At these paces disturbed ground carries no walker, however soft: k_L may be 155 N/m as well as 165 to 185."""
    cells = cells_of(drawn(("disturbed_ground",), seed=1, levels=3, omega=(16, 20, 26)))
    model = model_of("simple", ("disturbed_ground",), EFFECTS)
    found = fit(model, cells)
    at, nuisances = model.names.index("disturbed_ground.k_l_n_per_m"), nuisances_for(found, DEFAULT)
    outside = found.point.theta.copy()
    outside[at] = 155.0
    point = solve_from((model, cells, replace(found.point, theta=outside), nuisances))
    assert 165.0 <= point.theta[at] <= 185.0
    beside = fitted_at(model, cells, point, nuisances)
    assert beside.deviance < fitted_at(model, cells, replace(point, theta=outside), nuisances).deviance + 1.0


@pytest.mark.parametrize(("held", "begun"), [({"stance_overlap.eta": 0.05}, 1), ({}, 4)], ids=["held", "free"])
def test_a_parameter_that_is_held_needs_no_start_of_its_own(drawn, monkeypatch, held, begun):
    """Four equal rows would be descended four times; a free one is begun at four values."""
    cells, rows = cells_of(drawn(("stance_overlap",), seed=3)), []
    near = fit(model_of("simple", (), EFFECTS), cells).warm_start

    def counted(problem, states, *args, **kwargs):
        rows.append(len(states.theta))
        return descend(problem, states, *args, **kwargs)

    monkeypatch.setattr(global_minimum, "descend", counted)
    nearby_state(Problem(model_of("simple", ("stance_overlap",), EFFECTS, held=held), cells), (near,))
    assert rows[0] == begun
