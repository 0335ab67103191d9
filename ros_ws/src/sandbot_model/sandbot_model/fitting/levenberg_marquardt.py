"""Levenberg-Marquardt on (θ, ln k) from many starts at once."""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Floats, Ints
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States

ITERATIONS = 30
TOLERANCE = 1e-2
"""The descent ends with a step that lowers the deviance by less than this."""
NOT_SEARCHED = "v_swim_m_s"
"""The one parameter left to the descents, which always find it: no switch depends on it."""
PATIENCE, NEARER = 3, 0.02
"""Every so many iterations, a row above a hopeless deviance must have covered this fraction of the way down to it."""
MAX_DAMPING = 1e5
"""Damping beyond which a row is no longer improved."""


def descend(
    problem: Problem, states: States, iterations: int = ITERATIONS, fixed: Sequence[int] = (), hopeless: float = np.inf
) -> States:
    """The local minimum that each row descends to; the parameters ``fixed``, by index in θ, are held.

    Rows above a deviance that is ``hopeless`` end early unless they keep approaching it.
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
        trial = _step(problem, here, jacobian[at], damping[at], fixed)
        gain = here.deviance - trial.deviance
        better = moved[at] = gain > 0
        states = replace_rows(states, at, here.where(better, trial))
        damping[at] = np.where(better, np.maximum(damping[at] / 10, 1e-9), damping[at] * 10)
        active[at] = np.where(better, gain > TOLERANCE, damping[at] < MAX_DAMPING)
        if done % PATIENCE == 0 and np.isfinite(hopeless):
            above = states.deviance - hopeless
            active &= (above <= 0) | (begun - states.deviance > NEARER * above)
            begun = states.deviance
    return states


def bounds(problem: Problem) -> tuple[Floats, Floats]:
    """Lower and upper ends of the search ranges, ``(parameters,)`` each."""
    return problem.model.bounds


def _step(problem: Problem, states: States, jacobian: Floats, damping: Floats, fixed: Sequence[int]) -> States:
    """Each row after one damped step; parameters that are fixed or pressed against a bound are held."""
    low, high = bounds(problem)
    count = states.theta.shape[1]
    free = np.ones(count, dtype=bool)
    free[list(fixed)] = False
    step = problem.cell_means.step(jacobian, states.all_residuals, states.theta, low, high, free, damping)
    theta = np.clip(states.theta + step[:, :count], low, high)
    own = count + states.ln_k.shape[1]
    ln_k = states.ln_k + np.clip(step[:, count:own], -0.2, 0.2)
    return problem.states(theta, ln_k, states.slope, problem.bed(states) + step[:, own:])


def replace_rows(states: States, at: Ints, some: States) -> States:
    """The states with the rows ``at`` replaced by ``some``."""
    if len(at) == len(states.theta):
        return some
    index = np.zeros(len(states.theta), dtype=np.int64)
    index[at] = np.arange(len(at))
    changed = np.zeros(len(states.theta), dtype=bool)
    changed[at] = True
    return states.where(changed, some.take(index))
