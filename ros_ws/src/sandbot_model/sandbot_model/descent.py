"""Levenberg-Marquardt on (θ, ln k), and a look along every k for a better valley."""

import numpy as np

from sandbot_model.chain import Array
from sandbot_model.problem import Problem, State

ITERATIONS = 30
REJECTIONS = 5
ENOUGH = 1e-2
"""A step that lowers the deviance by less is the last."""
SHIFTS = np.concatenate([-(s := np.array([0.002, 0.005, 0.01, 0.018, 0.03, 0.05])), s])
"""Relative shifts of k tried for a better valley."""
REACHES = np.concatenate([-(r := np.array([0.02, 0.05, 0.1, 0.16, 0.24, 0.36, 0.5])), r])
"""Shifts of an effect's parameter tried, in plausible ranges."""


def descend(problem: Problem, theta: Array, ln_k: Array, slope: Array, iterations: int = ITERATIONS) -> State:
    """The minimum downhill from (θ, ln k), with dk/dφ as given."""
    low, high = bounds(problem)
    state = problem.state(np.clip(theta, low, high), ln_k, slope)
    damping = 1e-2
    for _ in range(iterations):
        jacobian = full_jacobian(problem, state)
        gradient = jacobian.T @ state.residual.ravel()
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-9)
        free = _free(problem, state, gradient)
        better = None
        for _ in range(REJECTIONS):
            step = _step(jacobian[:, free], gradient[free], scale[free], damping)
            trial = _moved(problem, state, step, free)
            if trial.deviance < state.deviance:
                better = trial
                damping = max(damping / 10, 1e-9)
                break
            damping *= 10
        if better is None:
            return state
        gained, state = state.deviance - better.deviance, better
        if gained < ENOUGH:
            return state
    return state


def look_along_k(problem: Problem, state: State) -> State:
    """Shift every k by itself and keep what helps: given θ the levels do not know of each other."""
    rows = np.concatenate([[0.0], np.log1p(SHIFTS)])
    ln_k = state.ln_k + rows[:, None]
    cells = problem.deviances(np.repeat(state.theta[None], len(rows), axis=0), ln_k, state.slope)
    value = np.add.reduceat(cells, _level_starts(problem), axis=1)
    best = np.where(value.min(axis=0) < value[0] - ENOUGH, value.argmin(axis=0), 0)
    if not best.any():
        return state
    moved = problem.state(state.theta, ln_k[best, np.arange(len(best))], state.slope)
    return moved if moved.deviance < state.deviance else state


def look_along_theta(problem: Problem, state: State) -> State:
    """Shift every effect's parameter, with all k's following: where a switch begins has no slope to descend along."""
    for index, (name, one) in enumerate(zip(problem.model.names, problem.model.parameters, strict=True)):
        if "." not in name:
            continue
        low, high = one.search
        theta = np.repeat(state.theta[None], len(REACHES), axis=0)
        theta[:, index] = np.clip(theta[:, index] + REACHES * (one.high - one.low), low, high)
        ln_k = state.ln_k + (theta[:, index] - state.theta[index])[:, None] * _following(problem, state, index)
        for tried in (ln_k, np.repeat(state.ln_k[None], len(REACHES), axis=0)):
            value = problem.deviances(theta, tried, state.slope).sum(axis=1)
            best = int(value.argmin())
            if value[best] < state.deviance - ENOUGH:
                state = problem.state(theta[best], tried[best], state.slope)
                break
    return state


def _following(problem: Problem, state: State, index: int) -> Array:
    """d ln k/dθ ``(levels,)`` that keeps a level's cells as they are, to first order."""
    local = problem.jacobian(state)
    own, other = local[:, :, -1], local[:, :, index]
    levels = problem.cells.level
    pull = np.bincount(levels, np.sum(own * other, axis=1), len(state.ln_k))
    weight = np.bincount(levels, np.sum(own**2, axis=1), len(state.ln_k))
    return -pull / np.maximum(weight, 1e-9)


def _level_starts(problem: Problem) -> Array:
    return np.unique(problem.cells.level, return_index=True)[1]


def full_jacobian(problem: Problem, state: State) -> Array:
    """d(whitened prediction)/d(θ, ln k of every level), shape ``(4 cells, parameters + levels)``."""
    local = problem.jacobian(state)
    cells, count, levels = problem.cells, len(state.theta), len(state.ln_k)
    full = np.zeros((len(cells), 4, count + levels))
    full[:, :, :count] = local[:, :, :count]
    full[np.arange(len(cells)), :, count + cells.level] = local[:, :, count]
    return full.reshape(-1, count + levels)


def bounds(problem: Problem) -> tuple[Array, Array]:
    """What a fit may search, ``(parameters,)`` each."""
    search = np.array([one.search for one in problem.model.parameters])
    return search[:, 0], search[:, 1]


def _free(problem: Problem, state: State, gradient: Array) -> Array:
    """Indices of unknowns that are not pressed against a bound."""
    low, high = bounds(problem)
    count = len(state.theta)
    pressed = ((state.theta <= low) & (gradient[:count] < 0)) | ((state.theta >= high) & (gradient[:count] > 0))
    return np.flatnonzero(np.concatenate([~pressed, np.ones(len(state.ln_k), dtype=bool)]))


def _step(jacobian: Array, gradient: Array, scale: Array, damping: float) -> Array:
    scaled = jacobian / scale
    normal = scaled.T @ scaled
    normal[np.diag_indices_from(normal)] += damping
    return np.asarray(np.linalg.solve(normal, gradient / scale) / scale)


def _moved(problem: Problem, state: State, step: Array, free: Array) -> State:
    low, high = bounds(problem)
    count = len(state.theta)
    move = np.zeros(count + len(state.ln_k))
    move[free] = step
    theta = np.clip(state.theta + move[:count], low, high)
    return problem.state(theta, state.ln_k + np.clip(move[count:], -0.2, 0.2), state.slope)
