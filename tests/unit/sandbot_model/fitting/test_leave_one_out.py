"""Leave-one-out: what a linear step says, against really fitting without the cell."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting import leave_one_out as module
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.global_minimum import nearby_state
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.leave_one_out import cross_validation, leave_one_out, left_out_with
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

MODEL = model_of("simple", (), catalogue())


@pytest.fixture(scope="module")
def base(drawn):
    return fit(MODEL, cells_of(drawn(seed=3, levels=3)))


@pytest.fixture(scope="module")
def found(base):
    return leave_one_out(base.problem, base.state, full_jacobian(base.problem, base.state)[0])


def test_it_is_what_a_fit_without_the_cell_predicts(base, found):
    cells = base.cells
    noise = np.sqrt(base.problem.covariance[:, Observable.speed, Observable.speed])
    for cell in np.flatnonzero(found.scored)[:6]:
        without = nearby_state(Problem(MODEL, cells.without(cell)), (base.warm_start,))
        whole = base.problem.states(without.theta, without.ln_k, base.state.slope)
        residual = cells.mean[cell, Observable.speed] - whole.predicted[0, cell, Observable.speed]
        assert found.residual[cell, Observable.speed] == pytest.approx(residual, abs=0.3 * noise[cell])


def test_out_of_sample_is_worse_than_in_sample(base, found):
    missed = (base.cells.mean - base.predicted)[found.scored, Observable.speed]
    assert np.sum(found.residual[found.scored, Observable.speed] ** 2) > np.sum(missed**2)
    assert found.deviance > base.deviance


def test_a_cell_that_no_other_determines_is_not_scored(drawn):
    """One cell a level: only the levels beside it say anything of its k."""
    lonely = fit(MODEL, cells_of(drawn(levels=3, omega=(8,))))
    jacobian = full_jacobian(lonely.problem, lonely.state)[0]
    assert not leave_one_out(lonely.problem, lonely.state, jacobian).scored.any()
    summed = cross_validation(lonely.problem, lonely.state, jacobian)
    assert summed.cells == 0
    assert np.isnan(summed.rmse["speed"])


def by_frequency(trials):
    return replace(trials, batch=np.array([f"day{omega:g}" for omega in trials.omega_rad_s]))


def test_the_cells_of_a_day_are_left_out_together(drawn):
    cells = cells_of(by_frequency(drawn(levels=3)))
    np.testing.assert_array_equal(left_out_with(cells), cells.omega[:, None] == cells.omega)


def test_cells_spread_over_blocks_are_left_out_alone(drawn):
    trials = drawn(levels=3)
    blocks = replace(trials, batch=np.array([f"block{index % 3}" for index in range(len(trials))]))
    np.testing.assert_array_equal(left_out_with(cells_of(blocks)), np.eye(21, dtype=bool))
    np.testing.assert_array_equal(left_out_with(cells_of(trials)), np.eye(21, dtype=bool))


def test_a_day_left_out_is_what_a_fit_without_it_predicts(drawn):
    days = fit(MODEL, cells_of(by_frequency(drawn(seed=3, levels=3))))
    found = leave_one_out(days.problem, days.state, full_jacobian(days.problem, days.state)[0])
    noise = np.sqrt(days.problem.covariance[:, Observable.speed, Observable.speed])
    for cell in np.flatnonzero(found.scored)[:4]:
        fewer = days.cells.without(np.flatnonzero(days.cells.omega == days.cells.omega[cell]))
        without = nearby_state(Problem(MODEL, fewer), (days.warm_start,))
        whole = days.problem.states(without.theta, without.ln_k, days.state.slope)
        residual = days.cells.mean[cell, Observable.speed] - whole.predicted[0, cell, Observable.speed]
        assert found.residual[cell, Observable.speed] == pytest.approx(residual, abs=0.3 * noise[cell])


@pytest.mark.parametrize("again", [True, False])
def test_a_cell_fitted_again_takes_nothing_from_the_step_that_is_not_trusted(base, monkeypatch, again):
    """Not even the offsets of the blocks, which the step has wrong here."""
    count = len(base.cells)
    by_block = np.eye(3)[np.arange(count) % 3]
    names, flat = ("one", "two", "three"), np.zeros((count, 4, 3))
    offsets = Nuisances(names, np.full(3, 0.01), flat, np.full(count, 0.01), np.zeros(3), by_block)
    own = fitted_at(MODEL, base.cells, base.point, offsets)
    jacobian = full_jacobian(own.problem, own.state)[0]
    monkeypatch.setattr(module, "_moved_far", lambda *_: np.full(count, again))
    right = leave_one_out(own.problem, own.state, jacobian)
    theta, ln_k, shared, speed_sd = module._linear_step(own.problem, own.state, jacobian)
    monkeypatch.setattr(module, "_linear_step", lambda *_: (theta, ln_k, shared + 0.05, speed_sd))
    wrong = leave_one_out(own.problem, own.state, jacobian)
    assert right.scored.any()
    assert np.array_equal(wrong.residual[right.scored], right.residual[right.scored], equal_nan=True) == again
