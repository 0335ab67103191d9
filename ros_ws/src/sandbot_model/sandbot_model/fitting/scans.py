"""Scans along every k and every shared parameter for a better valley, where a descent sees no slope."""

import numpy as np

from sandbot_model.fitting.jacobian import cell_jacobian
from sandbot_model.fitting.levenberg_marquardt import TOLERANCE, bounds
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States, joined
from sandbot_model.physics.arrays import Array, Ints

SHIFTS = np.concatenate([[0.0], -(s := np.array([1, 2.5, 5, 9, 15, 25, 40]) * 1e-3), s])
"""Relative shifts of k tried for a better valley."""
ACROSS = np.geomspace(0.78, 1.28, 40)
"""k over the median of all levels."""
OFFSETS = np.array([-2.0, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 2.0])
"""Shifts of an offset of the bed tried, in units of its prior."""
REACHES = np.concatenate([-(r := np.array([0.02, 0.05, 0.1, 0.16, 0.24, 0.36, 0.5])), r])
"""Shifts of an effect's parameter tried, in plausible ranges."""


def look_along_k(problem: Problem, state: States) -> States:
    """Try other k's for every level, near its own and across all; given θ the levels are independent. One row."""
    near = state.ln_k + np.log1p(SHIFTS)[:, None]
    across = np.median(state.ln_k) + np.log(ACROSS)[:, None] + np.zeros_like(state.ln_k)
    ln_k = np.concatenate([near, across])
    tried = problem.states(np.repeat(state.theta, len(ln_k), axis=0), ln_k, state.slope, problem.bed(state))
    value = np.add.reduceat(tried.cell_deviance, _level_starts(problem), axis=1)
    if (readings := problem.cells.pressed) is not None:
        np.add.at(value.T, readings.level, tried.pressed.T**2)
    best = np.where(value.min(axis=0) < value[0] - TOLERANCE, value.argmin(axis=0), 0)
    if not best.any():
        return state
    moved = problem.states(state.theta, ln_k[best, np.arange(len(best))][None], state.slope, problem.bed(state))
    return moved if moved.deviance[0] < state.deviance[0] else state


def look_along_theta(problem: Problem, state: States) -> States:
    """Shift every shared parameter, with every k adjusted to it or unchanged: the deviance shows no slope where a
    switch begins."""
    low, high = bounds(problem)
    response = k_response(problem, state)
    for index, (name, parameter) in enumerate(zip(problem.model.names, problem.model.parameters, strict=True)):
        reach = state.theta[0, index] if "." not in name else parameter.high - parameter.low
        theta = np.repeat(state.theta, len(REACHES), axis=0)
        theta[:, index] = np.clip(theta[:, index] + REACHES * reach, low[index], high[index])
        moves = (theta[:, index] - state.theta[0, index])[:, None]
        tried = problem.states(
            np.concatenate([theta, theta]),
            np.concatenate([state.ln_k + bounded(moves * response[index]), state.ln_k + 0 * moves]),
            state.slope[0],
            problem.bed(state),
        )
        best = np.argmin(tried.deviance)
        if tried.deviance[best] < state.deviance[0] - TOLERANCE:
            state = tried.take(np.array([best]))
            response = k_response(problem, state)
    return state


def look_along_bed(problem: Problem, state: States) -> States:
    """Shift every offset of the bed, all that gain at once or else the one that gains most. One row."""
    if problem.nuisances is None or not problem.nuisances.moves_k.any():
        return state
    bed = np.flatnonzero(problem.nuisances.moves_k)
    shift = problem.nuisances.sd[bed, None] * OFFSETS
    tried = np.repeat(problem.bed(state), shift.size, axis=0)
    tried[np.arange(shift.size), np.repeat(bed, len(OFFSETS))] += shift.ravel()
    rows = np.zeros(len(tried), dtype=np.int64)
    found = problem.states(state.theta[rows], state.ln_k[rows], state.slope, tried)
    deviance = found.deviance.reshape(shift.shape)
    gains = deviance.min(axis=1) < state.deviance[0] - TOLERANCE
    if not gains.any():
        return state
    every = problem.bed(state)
    every[0, bed] += np.where(gains, shift[np.arange(len(bed)), deviance.argmin(axis=1)], 0.0)
    both = joined([problem.states(state.theta, state.ln_k, state.slope, every), found])
    return both.take(np.argsort(both.deviance)[:1])


def k_response(problem: Problem, state: States) -> Array:
    """Response of k to the shared parameters: d ln k/dθ ``(parameters, levels)`` that changes a level's cells least, to
    first order. One row."""
    local = np.moveaxis(cell_jacobian(problem, state)[0], -1, 0)
    own, others = local[-1], local[:-1]
    first = _level_starts(problem)
    pull = np.add.reduceat(np.sum(own * others, axis=-1), first, axis=-1)
    weight = np.add.reduceat(np.sum(own**2, axis=-1), first)
    return np.asarray(-pull / np.maximum(weight, 1e-9))


def bounded(change: Array) -> Array:
    """A change of ln k, clipped to what a fit can need."""
    return np.clip(change, -1.0, 1.0)


def _level_starts(problem: Problem) -> Ints:
    return np.unique(problem.cells.level, return_index=True)[1]
