"""The profile of one parameter across cliffs (see ``sample``): steps to either side, each started from the last."""

import numpy as np

from sandbot_model.fitting.levenberg_marquardt import descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.scans import scan_bed, scan_k, scan_theta
from sandbot_model.fitting.states import States, joined

ITERATIONS = 8
SIGNIFICANT, MAX_RISE, MATTERS = 0.5, 9.0, 25.0
"""Rise of the deviance that is significant, that a profile may end at, and up to which a point matters; at one standard
error it is 1."""
PASSED = 2
"""Points in a row with a rise above ``MAX_RISE`` after which a profile ends."""
ALWAYS_COVERED = 1 / 64
"""Fraction of a plausible range that a profile covers in any case: beyond a cliff the deviance may be as low again."""
UNKNOWN = 1 / 512
"""First step of a parameter without a standard error, as a fraction of its plausible range."""


def stepwise_profile(problem: Problem, begin: States, index: int, error: float) -> States:
    """The best fits with θ[index] held at values to both sides of ``begin``, in order; ``error`` is its standard error.

    Distances double until the deviance has risen; then each point is refitted from a lower neighbour.
    """
    parameter, here = problem.model.parameters[index], float(begin.theta[0, index])
    first = 0.5 * error if 0 < error < parameter.width else UNKNOWN * parameter.width
    found = [begin]
    for side in (-first, first):
        state, beyond = begin, 0
        for away in side * 2.0 ** np.arange(np.ceil(np.log2(parameter.width / first)) + 1):
            value = float(np.clip(here + away, *parameter.search))
            farther = beyond >= PASSED and abs(away) > ALWAYS_COVERED * parameter.width
            if value == state.theta[0, index] or farther:
                break
            state = _held_at(problem, state, index, value)
            found.append(state)
            beyond = beyond + 1 if _deviance(state) > min(map(_deviance, found)) + MAX_RISE else 0
    found.sort(key=lambda state: float(state.theta[0, index]))
    return joined(_from_lower_neighbours(problem, found, index))


def _from_lower_neighbours(problem: Problem, found: list[States], index: int) -> list[States]:
    """The same, each point refitted from a lower neighbour that matters: upwards, then downwards."""
    for at in (*range(1, len(found)), *range(len(found) - 2, -1, -1)):
        lower = min(found[max(at - 1, 0) : at + 2], key=_deviance)
        if lower is not found[at] and _deviance(lower) < min(map(_deviance, found)) + MATTERS:
            refitted = _held_at(problem, lower, index, float(found[at].theta[0, index]))
            found[at] = min(found[at], refitted, key=_deviance)
    return found


def _held_at(problem: Problem, state: States, index: int, value: float) -> States:
    """The best fit near a state with one parameter held at ``value``; scans along all else where the deviance rises.
    One row."""
    theta = state.theta.copy()
    theta[:, index] = value
    begin = problem.states(theta, state.ln_k, state.slope, problem.bed(state))
    found = scan_k(problem, descend(problem, begin, ITERATIONS, fixed=[index]))
    if _deviance(found) > _deviance(state) + SIGNIFICANT:
        found = scan_bed(problem, scan_theta(problem, found, index))
    return descend(problem, found, ITERATIONS, fixed=[index])


def _deviance(state: States) -> float:
    return float(state.deviance[0])
