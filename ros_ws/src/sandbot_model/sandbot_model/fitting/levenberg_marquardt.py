"""Levenberg-Marquardt on (θ, ln k) from many starts at once."""

from collections.abc import Sequence

import numpy as np

from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.physics.arrays import Array, Ints

ITERATIONS = 30
TOLERANCE = 1e-2
"""The descent ends with a step that lowers the deviance by less than this."""
FOUND_AT_ONCE = "v_swim_m_s"
"""The parameter that any descent finds: no switch depends on it, and no search beside descents looks for it."""
PATIENCE, NEARER = 3, 0.02
"""Iterations in which a row that is above a hopeless deviance must come so much of the way nearer to it."""
MAX_DAMPING = 1e5
"""Damping beyond which a row is no longer improved."""


def descend(
    problem: Problem,
    states: States,
    iterations: int = ITERATIONS,
    fixed: Sequence[int] = (),
    hopeless: float = np.inf,
) -> States:
    """The local minimum that each row descends to; the parameters ``fixed``, by index in θ, stay where they are.

    Rows above a deviance that is ``hopeless`` end where they come hardly nearer to it.
    """
    begun = states.deviance
    rows = np.arange(len(states.theta))
    damping = np.full(len(rows), 1e-2)
    active = np.ones(len(rows), dtype=bool)
    jacobian, moved = full_jacobian(problem, states, switches=True), np.zeros(len(rows), dtype=bool)
    for done in range(1, iterations + 1):
        at = np.flatnonzero(active)
        if not len(at):
            break
        if (new := at[moved[at]]).size:
            jacobian[new] = full_jacobian(problem, states.take(new), switches=True)
        here = states.take(at)
        trial = _moved(problem, here, jacobian[at], damping[at], fixed)
        gain = here.deviance - trial.deviance
        better = moved[at] = gain > 0
        states = put(states, at, here.where(better, trial))
        damping[at] = np.where(better, np.maximum(damping[at] / 10, 1e-9), damping[at] * 10)
        active[at] = np.where(better, gain > TOLERANCE, damping[at] < MAX_DAMPING)
        if done % PATIENCE == 0 and np.isfinite(hopeless):
            above = states.deviance - hopeless
            active &= (above <= 0) | (begun - states.deviance > NEARER * above)
            begun = states.deviance
    return states


def bounds(problem: Problem) -> tuple[Array, Array]:
    """What a fit may search, ``(parameters,)`` each."""
    return problem.model.bounds


def _moved(problem: Problem, states: States, jacobian: Array, damping: Array, fixed: Sequence[int]) -> States:
    """Each row after one damped step, parameters that are fixed or pressed against a bound held."""
    low, high = bounds(problem)
    count = states.theta.shape[1]
    free = np.ones(count, dtype=bool)
    free[list(fixed)] = False
    step = problem.cell_means.step(jacobian, states.all_residuals, states.theta, low, high, free, damping)
    theta = np.clip(states.theta + step[:, :count], low, high)
    own = count + states.ln_k.shape[1]
    ln_k = states.ln_k + np.clip(step[:, count:own], -0.2, 0.2)
    return problem.states(theta, ln_k, states.slope, problem.bed(states) + step[:, own:])


def put(states: States, at: Ints, some: States) -> States:
    """The states with ``some`` in the place of the rows ``at``."""
    if len(at) == len(states.theta):
        return some
    index = np.zeros(len(states.theta), dtype=np.int64)
    index[at] = np.arange(len(at))
    changed = np.zeros(len(states.theta), dtype=bool)
    changed[at] = True
    return states.where(changed, some.take(index))
