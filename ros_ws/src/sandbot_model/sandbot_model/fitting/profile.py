"""Profile likelihood: the deviance at given values of some parameters, everything else fitted again at each.

A threshold between two conditions acts alike wherever it is: the deviance is a staircase, a derivative along it knows
no error, and that of other parameters, which jump with it, is wrong. Errors are then taken from the profile over all
parameters of the effect: the rms distance from the fit, each point with weight exp(-ΔD/2) under a flat prior.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import point_at
from sandbot_model.fitting.levenberg_marquardt import TOLERANCE, descend, put
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.physics.arrays import Array, Ints
from sandbot_model.physics.effect import Parameter

ITERATIONS = 8
MOVES = 4
"""How often a fit moves on to the lowest place of its profile."""
GAINED = 0.1
"""What that must lower the deviance by."""
SWEEPS = 4
"""How often a grid is gone over from neighbour to neighbour."""
COUNTS, NEAR = 25.0, 5.0
"""Rise of the deviance above the least up to which a place counts, and above a place's own up to which it is tried."""
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
    stairs = [index for at in staircases(fit) for index in at if np.isnan(fit.stderr[index])]
    for index in stairs:
        for _ in range(MOVES):
            states = _over_grid(fit.problem, fit, _axes(fit, [index]), [index])
            best = states.take(np.argsort(states.deviance)[:1])
            if best.deviance[0] > fit.deviance - GAINED:
                break
            end = descend(fit.problem, best)
            fit = fitted_at(fit.model, fit.cells, point_at(fit.problem, end), fit.nuisances)
    return fit


@lru_cache(maxsize=32)
def with_profiled_errors(fit: Fit, problem: Problem | None = None) -> Fit:
    """The same fit; where the deviance is a staircase along a parameter of an effect, errors are those of a profile.

    ``problem`` may have more in it that trials share than the fit's own.
    """
    for at in staircases(fit):
        fit = replace(fit, stderr=_profiled(problem or fit.problem, fit, at))
    return fit


def staircases(fit: Fit) -> list[list[int]]:
    """For each effect along one of whose parameters the deviance is a staircase, where its parameters stand."""
    names = fit.model.names
    ats = [
        [names.index(f"{one.identifier}.{parameter.name}") for parameter in one.parameters] for one in fit.model.effects
    ]
    return [at for at in ats if np.isnan(fit.stderr[at]).any()]


def _profiled(problem: Problem, fit: Fit, at: Sequence[int]) -> Array:
    axes = _axes(fit, at)
    volume = np.prod(np.meshgrid(*map(_widths, axes), indexing="ij"), axis=0).ravel()
    states = _over_grid(problem, fit, axes, at)
    weight = volume * np.exp(-0.5 * (states.deviance - states.deviance.min()))
    away = np.concatenate([states.theta - fit.point.theta, states.ln_k - fit.point.ln_k], axis=1)
    # What is held scatters over the grid alone, all else about each point of it as well.
    own = fit.stderr.copy()
    own[at] = 0.0
    return np.asarray(np.sqrt(own**2 + weight @ away**2 / weight.sum()))


def _axes(fit: Fit, at: Sequence[int]) -> list[Array]:
    return [_held(fit.model.parameters[index], fit.point.theta[index], fit.stderr[index]) for index in at]


def _over_grid(problem: Problem, fit: Fit, axes: Sequence[Array], at: Sequence[int]) -> States:
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(at))
    start = problem.states(fit.point.theta[None], fit.point.ln_k[None], fit.point.slope[None])
    return _from_neighbours(problem, profile(problem, start, at, grid), at, [len(axis) for axis in axes])


def _from_neighbours(problem: Problem, states: States, at: Sequence[int], shape: Sequence[int]) -> States:
    """The same grid, each row tried again from the best of its neighbours until few gain.

    Where a cell switches between two values, a descent from the fit stops at the cliff.
    """
    for _ in range(SWEEPS):
        best = _best_neighbour(states.deviance.reshape(shape)).ravel()
        theta = states.theta[best].copy()
        theta[:, at] = states.theta[:, at]
        lower = states.deviance[best]
        rows = np.flatnonzero((lower < states.deviance - TOLERANCE) & (lower < lower.min() + COUNTS))
        if not len(rows):
            break
        its = states.take(best[rows])
        tried = problem.states(theta[rows], its.ln_k, its.slope, problem.bed(its))
        near = np.flatnonzero(tried.deviance < states.deviance[rows] + NEAR)
        if not len(near):
            break
        found, rows = descend(problem, tried.take(near), ITERATIONS, fixed=at), rows[near]
        better = found.deviance < states.deviance[rows] - TOLERANCE
        states = put(states, rows[better], found.take(np.flatnonzero(better))) if better.any() else states
    return states


def _best_neighbour(deviance: Array) -> Ints:
    """Index of the least deviance among a point of the grid and those beside it along every axis."""
    index = np.arange(deviance.size).reshape(deviance.shape)
    best, least = index.copy(), deviance.copy()
    for axis in range(deviance.ndim):
        for step in (-1, 1):
            beside = np.clip(np.arange(deviance.shape[axis]) + step, 0, deviance.shape[axis] - 1)
            its = np.take(deviance, beside, axis=axis)
            best = np.where(its < least, np.take(index, beside, axis=axis), best)
            least = np.minimum(its, least)
    return np.asarray(best)


def _held(parameter: Parameter, here: float, error: float) -> Array:
    """Values about the fit, closer together the nearer they are."""
    width = parameter.high - parameter.low
    away = SIGMAS * error if SIGMAS[-1] * error < width else AWAY * width
    return np.unique(np.clip([here, *(here - away), *(here + away)], *parameter.search))


def _widths(axis: Array) -> Array:
    """What each value stands for: halfway to its neighbours."""
    edges = np.concatenate([axis[:1], 0.5 * (axis[1:] + axis[:-1]), axis[-1:]])
    return np.asarray(np.diff(edges)) if len(axis) > 1 else np.ones(1)
