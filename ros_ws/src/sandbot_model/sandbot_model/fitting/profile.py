"""Profile likelihood: the deviance at given values of some parameters, everything else fitted again at each.

A threshold between two conditions acts alike wherever it is: the deviance is a staircase, and a descent stops on any
stair. Errors there are another matter (``errors``).
"""

from collections.abc import Sequence

import numpy as np

from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import point_at
from sandbot_model.fitting.levenberg_marquardt import TOLERANCE, descend, put
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.fitting.walked import COUNTS, ITERATIONS, SHOWS, walked
from sandbot_model.physics.arrays import Array, Ints
from sandbot_model.physics.effect import Parameter

MOVES = 4
"""How often a fit moves on to the lowest place of its profile."""
GAINED = 0.1
"""What that must lower the deviance by."""
SWEEPS = 4
"""How often a grid is gone over from neighbour to neighbour."""
NEAR = 5.0
"""Rise of the deviance above a place's own up to which what its neighbour has is tried."""
AWAY = 0.25 * 2.0 ** -np.arange(8)
"""How far from the fit, in plausible ranges to either side, a parameter without a standard error is held."""
SIGMAS = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
"""How far one with a standard error is, in those; one that is as large as its plausible range says nothing."""


def profile(problem: Problem, start: States, at: Sequence[int], values: Array) -> States:
    """The best fit with the parameters θ[at] held at each row of ``values (rows, len(at))``, from one state."""
    rows = np.zeros(len(values), dtype=np.int64)
    theta = start.theta[rows].copy()
    theta[:, at] = values
    begin = problem.states(theta, start.ln_k[rows], start.slope[rows], problem.bed(start))
    return descend(problem, begin, ITERATIONS, fixed=at)


def deepest(fit: Fit) -> Fit:
    """The same fit at the lowest place of its profiles: along a staircase a descent stops on any stair."""
    for index in determined(fit):
        for _ in range(MOVES):
            before, fit = fit, _at_lowest(fit, _over_axis(fit, index))
            if fit is before:
                break
    return fit


def lowest_along(fit: Fit) -> Fit:
    """The same fit at the lowest place of walks along each of its parameters."""
    for index in determined(fit):
        fit = _at_lowest(fit, walked(fit.problem, begun_at(fit.problem, fit), index, fit.stderr[index]))
    return fit


def _at_lowest(fit: Fit, states: States) -> Fit:
    """The fit that the lowest of these descends to, or the same where it gains nothing."""
    best = states.lowest()
    if best.deviance[0] > fit.deviance - GAINED:
        return fit
    end = descend(fit.problem, best)
    return fitted_at(fit.model, fit.cells, point_at(fit.problem, end), fit.nuisances)


def determined(fit: Fit) -> list[int]:
    """Where the parameters of effects stand, and Δt and v_swim where data determine them."""
    return [
        at
        for at, name in enumerate(fit.model.names)
        if name not in fit.model.held and ("." in name or fit.stderr[at] > 0)
    ]


def _scale(fit: Fit, index: int) -> float:
    """How far along a parameter the deviance begins to show it: its standard error, or, where that is the curvature at
    the brink of a cliff, many times more."""
    error, width = fit.stderr[index], fit.model.parameters[index].width
    if not 0 < error < width:
        return float(error)
    away = error * 2.0 ** np.arange(-1, np.ceil(np.log2(width / error)) + 1)
    values = fit.point.theta[index] + np.concatenate([[0.0], -away, away])
    values = np.clip(values, *fit.model.parameters[index].search)
    deviance = profile(fit.problem, begun_at(fit.problem, fit), [index], values[:, None]).deviance
    shown = np.concatenate([away, away])[(deviance - deviance.min())[1:] > SHOWS]
    return float(shown.min(initial=width))


def begun_at(problem: Problem, fit: Fit) -> States:
    """A fit's place, under what ``problem`` may have more in it that trials share. One row."""
    return problem.states(fit.point.theta[None], fit.point.ln_k[None], fit.point.slope[None])


def _over_axis(fit: Fit, index: int) -> States:
    """The profile at values about a fit, in order, each tried again from the better of its neighbours until few gain.

    Where a cell switches between two values, a descent from the fit stops at the cliff.
    """
    values, problem = _held(fit.model.parameters[index], fit.point.theta[index], _scale(fit, index)), fit.problem
    states = profile(problem, begun_at(problem, fit), [index], values[:, None])
    for _ in range(SWEEPS):
        best = _best_neighbour(states.deviance)
        theta, lower = states.theta[best].copy(), states.deviance[best]
        theta[:, index] = values
        rows = np.flatnonzero((lower < states.deviance - TOLERANCE) & (lower < lower.min() + COUNTS))
        if not len(rows):
            break
        its = states.take(best[rows])
        tried = problem.states(theta[rows], its.ln_k, its.slope, problem.bed(its))
        near = np.flatnonzero(tried.deviance < states.deviance[rows] + NEAR)
        if not len(near):
            break
        found, rows = descend(problem, tried.take(near), ITERATIONS, fixed=[index]), rows[near]
        better = found.deviance < states.deviance[rows] - TOLERANCE
        states = put(states, rows[better], found.take(np.flatnonzero(better))) if better.any() else states
    return states


def _best_neighbour(deviance: Array) -> Ints:
    """Index of the least of each and those beside it."""
    every = np.pad(deviance, 1, constant_values=np.inf)
    beside = np.stack([every[1:-1], every[:-2], every[2:]])
    return np.asarray(np.arange(len(deviance)) + np.array([0, -1, 1])[beside.argmin(axis=0)])


def _held(parameter: Parameter, here: float, error: float) -> Array:
    """Values about the fit, closer together the nearer they are."""
    width = parameter.width
    away = SIGMAS * error if SIGMAS[-1] * error < width else AWAY * width
    return np.unique(np.clip([here, *(here - away), *(here + away)], *parameter.search))
