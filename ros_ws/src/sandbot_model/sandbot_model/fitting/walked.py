"""The profile of one parameter across cliffs (see ``sample``): steps to either side, each begun where the last has
come to."""

import numpy as np

from sandbot_model.fitting.levenberg_marquardt import descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.scans import look_along_bed, look_along_k, look_along_theta
from sandbot_model.fitting.states import States, joined

ITERATIONS = 8
SHOWS, FALLEN, COUNTS = 0.5, 9.0, 25.0
"""Rise of the deviance that shows how far away a place is, at which a profile may end, and up to which a place counts;
one standard error away it is 1."""
PASSED = 2
"""Places at which it has risen after which no farther one is tried."""
LOOKED_OVER = 1 / 64
"""Share of a plausible range that is looked over all the same: beyond a cliff it may be as low again."""
UNKNOWN = 1 / 512
"""First step, as share of the plausible range, of a parameter without a standard error."""


def walked(problem: Problem, begin: States, index: int, error: float) -> States:
    """The best fits with θ[index] held at values on both sides of a state's, in order; ``error`` is its standard error.

    Each value is twice as far away as the last, until the deviance has risen; then each is tried again from a lower
    neighbour.
    """
    parameter, here = problem.model.parameters[index], float(begin.theta[0, index])
    first = 0.5 * error if 0 < error < parameter.width else UNKNOWN * parameter.width
    found = [begin]
    for side in (-first, first):
        state, beyond = begin, 0
        for away in side * 2.0 ** np.arange(np.ceil(np.log2(parameter.width / first)) + 1):
            value = float(np.clip(here + away, *parameter.search))
            farther = beyond >= PASSED and abs(away) > LOOKED_OVER * parameter.width
            if value == state.theta[0, index] or farther:
                break
            state = _held_at(problem, state, index, value)
            found.append(state)
            beyond = beyond + 1 if _deviance(state) > min(map(_deviance, found)) + FALLEN else 0
    found.sort(key=lambda state: float(state.theta[0, index]))
    return joined(_from_lower_neighbours(problem, found, index))


def _from_lower_neighbours(problem: Problem, found: list[States], index: int) -> list[States]:
    """The same, each tried again from a lower neighbour that counts: upwards, then downwards."""
    for at in (*range(1, len(found)), *range(len(found) - 2, -1, -1)):
        lower = min(found[max(at - 1, 0) : at + 2], key=_deviance)
        if lower is not found[at] and _deviance(lower) < min(map(_deviance, found)) + COUNTS:
            again = _held_at(problem, lower, index, float(found[at].theta[0, index]))
            found[at] = min(found[at], again, key=_deviance)
    return found


def _held_at(problem: Problem, state: States, index: int, value: float) -> States:
    """The best fit near a state with one parameter held at another value: where it rises, after scans along all else.
    One row."""
    theta = state.theta.copy()
    theta[:, index] = value
    begin = problem.states(theta, state.ln_k, state.slope, problem.bed(state))
    found = look_along_k(problem, descend(problem, begin, ITERATIONS, fixed=[index]))
    if _deviance(found) > _deviance(state) + SHOWS:
        found = look_along_bed(problem, look_along_theta(problem, found, index))
    return descend(problem, found, ITERATIONS, fixed=[index])


def _deviance(state: States) -> float:
    return float(state.deviance[0])
