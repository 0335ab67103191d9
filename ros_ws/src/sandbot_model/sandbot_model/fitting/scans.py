"""Scans along every k, shared parameter and bed offset for a lower local minimum, where a descent sees no slope."""

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.fitting.jacobian import cell_jacobian
from sandbot_model.fitting.levenberg_marquardt import NOT_SEARCHED, TOLERANCE, bounds
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States

SHIFTS = np.concatenate([[0.0], -(s := np.array([1, 2.5, 5, 9, 15, 25, 40]) * 1e-3), s])
"""Relative shifts of k tried."""
ACROSS = np.geomspace(0.78, 1.28, 40)
"""Further k tried, over the median of all levels."""
OFFSETS = np.array([-2.0, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 2.0])
"""Shifts of an offset of the bed tried, in units of its prior."""
REACHES = np.concatenate([-(r := np.array([0.02, 0.05, 0.1, 0.16, 0.24, 0.36, 0.5])), r])
"""Shifts of an effect's parameter tried, in plausible ranges."""


def scan_k(problem: Problem, state: States) -> States:
    """Try other values of every level's k, near its own and near the median; given all else, levels are independent.
    One row."""
    near = state.ln_k + np.log1p(SHIFTS)[:, None]
    across = np.median(state.ln_k) + np.log(ACROSS)[:, None] + np.zeros_like(state.ln_k)
    ln_k, shared = np.concatenate([near, across]), problem.shared(state)
    enough = by_level(problem, state) - TOLERANCE
    hopeful = by_level(problem.subset, evaluated_at(problem.subset, state, state.theta, ln_k, shared)) < enough
    # Every level has its own list of candidates: row i holds the i-th of each.
    order = np.argsort(~hopeful, axis=0, kind="stable")[: hopeful.sum(axis=0).max()]
    if not len(order):
        return state
    ln_k = np.take_along_axis(ln_k, order, axis=0)
    value = by_level(problem, evaluated_at(problem, state, state.theta, ln_k, shared))
    best = np.take_along_axis(ln_k, value.argmin(axis=0)[None], axis=0)
    best = np.where(value.min(axis=0) < enough, best, state.ln_k)
    moved = evaluated_at(problem, state, state.theta, best, problem.bed(state))
    return moved if moved.deviance[0] < state.deviance[0] else state


def scan_theta(problem: Problem, state: States, fixed: int | None = None) -> States:
    """Shift every shared parameter except ``fixed``, with every k adjusted to first order or unchanged. One row.

    Where a switch begins the deviance has no slope that a descent could follow.
    """
    low, high = bounds(problem)
    response = k_response(problem, state)
    for index, (name, parameter) in enumerate(zip(problem.model.names, problem.model.parameters, strict=True)):
        if index == fixed or name == NOT_SEARCHED:
            continue
        reach = state.theta[0, index] if "." not in name else parameter.width
        here = state.theta[0, index]
        shifted = np.unique(np.clip(here + REACHES * reach, low[index], high[index]))
        shifted = shifted[shifted != here]
        theta = np.repeat(state.theta, len(shifted), axis=0)
        theta[:, index] = shifted
        moves = (shifted - here)[:, None]
        both = np.concatenate([state.ln_k + bounded(moves * response[index]), state.ln_k + 0 * moves])
        found = _lowest_below(problem, state, np.concatenate([theta, theta]), both)
        if found is not state:
            state, response = found, k_response(problem, found)
    return state


def _lowest_below(problem: Problem, state: States, theta: Floats, ln_k: Floats) -> States:
    """The best of the rows, or ``state`` where none is lower. One row."""
    if not len(theta):
        return state
    enough, bed = state.deviance[0] - TOLERANCE, problem.bed(state)
    # A deviance on a subset of cells that exceeds the state's on all cells rules a row out.
    hopeful = np.flatnonzero(evaluated_at(problem.subset, state, theta, ln_k, bed).deviance < enough)
    if not len(hopeful):
        return state
    best = evaluated_at(problem, state, theta[hopeful], ln_k[hopeful], bed).lowest()
    return best if best.deviance[0] < enough else state


def scan_bed(problem: Problem, state: States) -> States:
    """Shift every offset of the bed, those without a common cell together; keep all gains or one group's. One row."""
    if problem.nuisances is None or not problem.nuisances.moves_k.any():
        return state
    shared, sd, own = problem.shared(state), problem.nuisances.sd, problem.nuisances.by_ln_k != 0
    shifts = []
    for part in _disjoint_groups(own):
        tried = np.repeat(shared, len(OFFSETS), axis=0)
        tried[:, part] += OFFSETS[:, None] * sd[part]
        found = evaluated_at(problem, state, state.theta, state.ln_k, tried)
        gain = _by_offset(state, own[:, part], part) - _by_offset(found, own[:, part], part)
        shift = np.zeros(len(sd))
        shift[part] = np.where(gain.max(axis=0) > TOLERANCE, OFFSETS[gain.argmax(axis=0)] * sd[part], 0.0)
        shifts += [shift] if shift.any() else []
    if not shifts:
        return state
    bed = problem.bed(state) + np.array([sum(shifts), *shifts])
    best = evaluated_at(problem, state, state.theta, state.ln_k, bed).lowest()
    return best if best.deviance[0] < state.deviance[0] else state


def evaluated_at(problem: Problem, state: States, theta: Floats, ln_k: Floats, shared: Floats) -> States:
    """One row's state with other θ, ln k or nuisances, each ``(rows or 1, ...)``."""
    rows = max(len(theta), len(ln_k), len(shared))
    theta, ln_k, shared = (np.repeat(each, rows // len(each), axis=0) for each in (theta, ln_k, shared))
    return problem.states(theta, ln_k, state.slope, shared)


def by_level(problem: Problem, states: States) -> Floats:
    """Deviance of each level's cells and readings ``(rows, levels)``."""
    value = _summed(problem, states.cell_deviance)
    if (readings := problem.cells.pressed) is not None:
        np.add.at(value.T, readings.level, states.pressed.T**2)
    return value


def _summed(problem: Problem, of_cells: Floats) -> Floats:
    """Sums of values ``(..., cells)`` over the cells of each level ``(..., levels)``."""
    return np.asarray(of_cells @ (problem.cells.level[:, None] == np.arange(len(problem.cells.level_phi))))


def _by_offset(states: States, own: Bools, part: Ints) -> Floats:
    """Deviance of the cells ``own (cells, offsets)`` of some offsets of the bed, plus that of the offsets' priors
    ``(rows, offsets)``."""
    return np.asarray(states.cell_deviance @ own + states.shared[:, part] ** 2)


def _disjoint_groups(own: Bools) -> list[Ints]:
    """Offsets in groups without a common cell, for the cells of each ``(cells, offsets)``."""
    parts: list[list[int]] = []
    for offset in np.flatnonzero(own.any(axis=0)).tolist():
        free = [part for part in parts if not (own[:, part].any(axis=1) & own[:, offset]).any()]
        if free:
            free[0].append(offset)
        else:
            parts.append([offset])
    return [np.array(part) for part in parts]


def k_response(problem: Problem, state: States) -> Floats:
    """Response of k to the shared parameters: the d ln k/dθ ``(parameters, levels)`` that changes the predictions of a
    level's cells least. One row."""
    local = np.moveaxis(cell_jacobian(problem, state)[0], -1, 0)
    own, others = local[-1], local[:-1]
    pull = _summed(problem, np.sum(own * others, axis=-1))
    weight = _summed(problem, np.sum(own**2, axis=-1))
    return np.asarray(-pull / np.maximum(weight, 1e-9))


def bounded(change: Floats) -> Floats:
    """A change of ln k, clipped to a factor e of k."""
    return np.clip(change, -1.0, 1.0)
