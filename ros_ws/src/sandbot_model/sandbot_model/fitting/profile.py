"""Profile likelihood: the deviance at given values of some parameters, everything else refitted at each.

A threshold has the same effect anywhere between two conditions: the deviance is a staircase, and a descent stops on any
step of it. For standard errors there see ``errors``.
"""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Floats, Ints
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import point_at
from sandbot_model.fitting.levenberg_marquardt import TOLERANCE, descend, replace_rows
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.fitting.stepwise_profile import ITERATIONS, MATTERS, SIGNIFICANT, stepwise_profile
from sandbot_model.physics.effect import Parameter

MOVES = 4
"""How often a fit may move to the minimum of its profile."""
LEAST_GAIN = 0.1
"""Least fall of the deviance for such a move."""
SWEEPS = 4
"""How often the points of a profile are refitted from their better neighbours."""
NEAR_RISE = 5.0
"""A point is refitted from its neighbour's unknowns if they raise its deviance by less than this."""
DISTANCES = 0.25 * 2.0 ** -np.arange(8)
"""Distances from the fit at which a parameter without a useful standard error is held, in plausible ranges."""
DISTANCES_SIGMA = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
"""The same for one with a standard error, in standard errors; one as large as the plausible range is useless."""


def profile(problem: Problem, start: States, at: Sequence[int], values: Floats) -> States:
    """The best fit with the parameters θ[at] held at each row of ``values (rows, len(at))``, from one state."""
    rows = np.zeros(len(values), dtype=np.int64)
    theta = start.theta[rows].copy()
    theta[:, at] = values
    begin = problem.states(theta, start.ln_k[rows], start.slope[rows], problem.bed(start))
    return descend(problem, begin, ITERATIONS, fixed=at)


def lowest_in_profiles(fit: Fit) -> Fit:
    """The same fit, moved to the minimum of its profile along each parameter in turn."""
    for index in determined(fit):
        for _ in range(MOVES):
            before, fit = fit, _at_lowest(fit, _axis_profile(fit, index))
            if fit is before:
                break
    return fit


def lowest_along(fit: Fit) -> Fit:
    """The same fit, moved to the minimum of its stepwise profile along each parameter in turn."""
    for index in determined(fit):
        fit = _at_lowest(fit, stepwise_profile(fit.problem, state_of_fit(fit.problem, fit), index, fit.stderr[index]))
    return fit


def _at_lowest(fit: Fit, states: States) -> Fit:
    """The fit that the lowest of the states descends to, or the same where it gains nothing."""
    best = states.lowest()
    if best.deviance[0] > fit.deviance - LEAST_GAIN:
        return fit
    end = descend(fit.problem, best)
    return fitted_at(fit.model, fit.cells, point_at(fit.problem, end), fit.nuisances)


def determined(fit: Fit) -> list[int]:
    """Indices in θ of the effects' parameters, and of Δt and v_swim where the data determine them."""
    return [at for at, name in enumerate(fit.model.names) if name not in fit.model.held and fit.determines(name)]


def _scale(fit: Fit, index: int) -> float:
    """The distance along a parameter at which the deviance begins to rise: its standard error, or many times more where
    that is only the curvature at the edge of a cliff."""
    error, width = fit.stderr[index], fit.model.parameters[index].width
    if not 0 < error < width:
        return float(error)
    away = error * 2.0 ** np.arange(-1, np.ceil(np.log2(width / error)) + 1)
    values = fit.point.theta[index] + np.concatenate([[0.0], -away, away])
    values = np.clip(values, *fit.model.parameters[index].search)
    deviance = profile(fit.problem, state_of_fit(fit.problem, fit), [index], values[:, None]).deviance
    shown = np.concatenate([away, away])[(deviance - deviance.min())[1:] > SIGNIFICANT]
    return float(shown.min(initial=width))


def state_of_fit(problem: Problem, fit: Fit) -> States:
    """The state of ``problem`` at a fit's point; it may have more nuisances than the fit. One row."""
    return problem.states(fit.point.theta[None], fit.point.ln_k[None], fit.point.slope[None])


def _axis_profile(fit: Fit, index: int) -> States:
    """The profile at values about a fit, in order, refitted from better neighbours until nothing improves.

    Where a cell switches between two values, a descent from the fit itself stops at the cliff.
    """
    values, problem = _held(fit.model.parameters[index], fit.point.theta[index], _scale(fit, index)), fit.problem
    states = profile(problem, state_of_fit(problem, fit), [index], values[:, None])
    for _ in range(SWEEPS):
        best = _best_neighbour(states.deviance)
        theta, lower = states.theta[best].copy(), states.deviance[best]
        theta[:, index] = values
        rows = np.flatnonzero((lower < states.deviance - TOLERANCE) & (lower < lower.min() + MATTERS))
        if not len(rows):
            break
        its = states.take(best[rows])
        tried = problem.states(theta[rows], its.ln_k, its.slope, problem.bed(its))
        near = np.flatnonzero(tried.deviance < states.deviance[rows] + NEAR_RISE)
        if not len(near):
            break
        found, rows = descend(problem, tried.take(near), ITERATIONS, fixed=[index]), rows[near]
        better = found.deviance < states.deviance[rows] - TOLERANCE
        states = replace_rows(states, rows[better], found.take(np.flatnonzero(better))) if better.any() else states
    return states


def _best_neighbour(deviance: Floats) -> Ints:
    """Index of the least of each value and its two neighbours."""
    every = np.pad(deviance, 1, constant_values=np.inf)
    candidates = np.stack([every[1:-1], every[:-2], every[2:]])
    return np.asarray(np.arange(len(deviance)) + np.array([0, -1, 1])[candidates.argmin(axis=0)])


def _held(parameter: Parameter, here: float, error: float) -> Floats:
    """Values about the fit, spaced more closely near it."""
    width = parameter.width
    away = DISTANCES_SIGMA * error if DISTANCES_SIGMA[-1] * error < width else DISTANCES * width
    return np.unique(np.clip([here, *(here - away), *(here + away)], *parameter.search))
