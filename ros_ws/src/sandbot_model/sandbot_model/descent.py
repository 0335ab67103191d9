"""Levenberg-Marquardt on (θ, ln k) from many starts at once, and a look along every k and θ for a better valley."""

import numpy as np

from sandbot_model.chain import Array, Ints
from sandbot_model.problem import Problem, States

ITERATIONS = 30
ENOUGH = 1e-2
"""A step that lowers the deviance by less is the last."""
STIFFEST = 1e5
"""Damping at which a row is given up."""
SHIFTS = np.concatenate([[0.0], -(s := np.array([1, 2.5, 5, 9, 15, 25, 40]) * 1e-3), s])
"""Relative shifts of k tried for a better valley."""
ACROSS = np.geomspace(0.78, 1.28, 40)
"""k over the median of all levels."""
REACHES = np.concatenate([-(r := np.array([0.02, 0.05, 0.1, 0.16, 0.24, 0.36, 0.5])), r])
"""Shifts of an effect's parameter tried, in plausible ranges."""


def descend(problem: Problem, states: States, iterations: int = ITERATIONS) -> States:
    """The minimum downhill from each row."""
    rows = np.arange(len(states.theta))
    damping = np.full(len(rows), 1e-2)
    active = np.ones(len(rows), dtype=bool)
    for _ in range(iterations):
        at = np.flatnonzero(active)
        if not len(at):
            break
        here = states.take(at)
        trial = _moved(problem, here, damping[at])
        gain = here.deviance - trial.deviance
        better = gain > 0
        states = _put(states, at, here.where(better, trial))
        damping[at] = np.where(better, np.maximum(damping[at] / 10, 1e-9), damping[at] * 10)
        active[at] = np.where(better, gain > ENOUGH, damping[at] < STIFFEST)
    return states


def look_along_k(problem: Problem, state: States) -> States:
    """Try other k's for every level, near its own and across all: given θ the levels do not meet. One row."""
    near = state.ln_k + np.log1p(SHIFTS)[:, None]
    across = np.median(state.ln_k) + np.log(ACROSS)[:, None] + np.zeros_like(state.ln_k)
    ln_k = np.concatenate([near, across])
    tried = problem.states(np.repeat(state.theta, len(ln_k), axis=0), ln_k, state.slope)
    value = np.add.reduceat(tried.cell_deviance, _level_starts(problem), axis=1)
    if (readings := problem.cells.pressed) is not None:
        np.add.at(value.T, readings.level, tried.pressed.T**2)
    best = np.where(value.min(axis=0) < value[0] - ENOUGH, value.argmin(axis=0), 0)
    if not best.any():
        return state
    moved = problem.states(state.theta, ln_k[best, np.arange(len(best))][None], state.slope)
    return moved if moved.deviance[0] < state.deviance[0] else state


def look_along_theta(problem: Problem, state: States) -> States:
    """Shift every shared parameter, with all k's following or staying: where a switch begins there is no slope."""
    low, high = bounds(problem)
    for index, (name, one) in enumerate(zip(problem.model.names, problem.model.parameters, strict=True)):
        reach = state.theta[0, index] if "." not in name else one.high - one.low
        theta = np.repeat(state.theta, len(REACHES), axis=0)
        theta[:, index] = np.clip(theta[:, index] + REACHES * reach, low[index], high[index])
        moves = (theta[:, index] - state.theta[0, index])[:, None]
        tried = problem.states(
            np.concatenate([theta, theta]),
            np.concatenate([state.ln_k + bounded(moves * following(problem, state)[index]), state.ln_k + 0 * moves]),
            state.slope[0],
        )
        best = np.argmin(tried.deviance)
        if tried.deviance[best] < state.deviance[0] - ENOUGH:
            state = tried.take(np.array([best]))
    return state


def full_jacobian(problem: Problem, states: States) -> Array:
    """d(whitened prediction)/d(θ, ln k of every level), ``(rows, 4 cells + readings, parameters + levels)``."""
    local = problem.jacobian(states)
    cells, count, levels = problem.cells, states.theta.shape[1], states.ln_k.shape[1]
    full = np.zeros((len(local), len(cells), 4, count + levels))
    full[..., :count] = local[..., :count]
    each = np.arange(len(cells))
    full[:, each, :, count + cells.level] = np.moveaxis(local[..., count], 1, 0)
    return np.concatenate([full.reshape(len(local), -1, count + levels), problem.pressed_jacobian(states)], axis=1)


def followed(problem: Problem, states: States) -> Array:
    """Orthonormal columns ``(4 cells + readings, rank)``: the residuals that one fit's own parameters can follow."""
    basis, singular, _ = np.linalg.svd(full_jacobian(problem, states)[0], full_matrices=False)
    return np.asarray(basis[:, singular > 1e-9 * singular[0]])


def off(values: Array, basis: Array) -> Array:
    """What of ``values (4 cells + readings, ...)`` is left beside what can be followed."""
    return np.asarray(values - basis @ (basis.T @ values))


def bounds(problem: Problem) -> tuple[Array, Array]:
    """What a fit may search, ``(parameters,)`` each."""
    search = np.array([one.search for one in problem.model.parameters])
    return search[:, 0], search[:, 1]


def _moved(problem: Problem, states: States, damping: Array) -> States:
    """Each row after one damped step, parameters pressed against a bound held."""
    low, high = bounds(problem)
    count = states.theta.shape[1]
    jacobian = full_jacobian(problem, states)
    transposed = np.swapaxes(jacobian, 1, 2)
    gradient = (transposed @ states.missed[..., None])[..., 0]
    normal = transposed @ jacobian
    scale = np.maximum(np.sqrt(np.diagonal(normal, axis1=1, axis2=2)), 1e-9)
    down, up = gradient[:, :count] < 0, gradient[:, :count] > 0
    held = np.zeros(gradient.shape, dtype=bool)
    held[:, :count] = ((states.theta <= low) & down) | ((states.theta >= high) & up)
    normal = normal / scale[:, :, None] / scale[:, None, :]
    normal = np.where(held[:, :, None] | held[:, None, :], 0.0, normal)
    normal += np.eye(normal.shape[1]) * (damping[:, None, None] + held[:, :, None])
    step = np.linalg.solve(normal, np.where(held, 0.0, gradient / scale)[..., None])[..., 0] / scale
    theta = np.clip(states.theta + step[:, :count], low, high)
    return problem.states(theta, states.ln_k + np.clip(step[:, count:], -0.2, 0.2), states.slope)


def _put(states: States, at: Ints, some: States) -> States:
    if len(at) == len(states.theta):
        return some
    index = np.zeros(len(states.theta), dtype=np.int64)
    index[at] = np.arange(len(at))
    changed = np.zeros(len(states.theta), dtype=bool)
    changed[at] = True
    return states.where(changed, some.take(index))


def following(problem: Problem, state: States) -> Array:
    """d ln k/dθ ``(parameters, levels)`` that keeps a level's cells as they are, to first order. One row."""
    local = np.moveaxis(problem.jacobian(state)[0], -1, 0)
    own, others = local[-1], local[:-1]
    first = _level_starts(problem)
    pull = np.add.reduceat(np.sum(own * others, axis=-1), first, axis=-1)
    weight = np.add.reduceat(np.sum(own**2, axis=-1), first)
    return np.asarray(-pull / np.maximum(weight, 1e-9))


def bounded(change: Array) -> Array:
    """A change of ln k no larger than a fit can want."""
    return np.clip(change, -1.0, 1.0)


def _level_starts(problem: Problem) -> Ints:
    return np.unique(problem.cells.level, return_index=True)[1]
