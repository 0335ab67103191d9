"""Profile likelihood: the deviance at given values of some parameters, everything else fitted again at each.

A threshold between two conditions acts alike wherever it is: the deviance is a staircase, a derivative along it knows
no error, and that of other parameters, which jump with it, is wrong. Errors are then taken from the profile over all
parameters of the effect: the rms distance from the fit, each point with weight exp(-ΔD/2) under a flat prior.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.levenberg_marquardt import descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.effect import Parameter

ITERATIONS = 8
AWAY = 0.25 * 2.0 ** -np.arange(8)
"""How far from the fit, in plausible ranges to either side, a parameter without a standard error is held."""
SIGMAS = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
"""How far one with a standard error is, in those; one that is as large as its plausible range says nothing."""


def profile(problem: Problem, start: States, at: Sequence[int], values: Array) -> States:
    """The best fit with the parameters θ[at] held at each row of ``values (rows, len(at))``, from one state."""
    rows = np.zeros(len(values), dtype=np.int64)
    theta = start.theta[rows].copy()
    theta[:, at] = values
    return descend(problem, problem.states(theta, start.ln_k[rows], start.slope[rows]), ITERATIONS, fixed=at)


@lru_cache(maxsize=32)
def with_profiled_errors(fit: Fit) -> Fit:
    """The same fit; where the deviance is a staircase along a parameter of an effect, errors are those of a profile."""
    for at in staircases(fit):
        fit = replace(fit, stderr=_profiled(fit, at))
    return fit


def staircases(fit: Fit) -> list[list[int]]:
    """For each effect along one of whose parameters the deviance is a staircase, where its parameters stand."""
    names = fit.model.names
    ats = [
        [names.index(f"{one.identifier}.{parameter.name}") for parameter in one.parameters] for one in fit.model.effects
    ]
    return [at for at in ats if np.isnan(fit.stderr[at]).any()]


def _profiled(fit: Fit, at: Sequence[int]) -> Array:
    here = np.concatenate([fit.point.theta, fit.point.ln_k])
    axes = [_held(fit.model.parameters[index], here[index], fit.stderr[index]) for index in at]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(at))
    volume = np.prod(np.meshgrid(*map(_widths, axes), indexing="ij"), axis=0).ravel()
    states = profile(fit.problem, fit.state, at, grid)
    weight = volume * np.exp(-0.5 * (states.deviance - states.deviance.min()))
    away = np.concatenate([states.theta, states.ln_k], axis=1) - here
    # What is held scatters over the grid alone, all else about each point of it as well.
    own = fit.stderr.copy()
    own[at] = 0.0
    return np.asarray(np.sqrt(own**2 + weight @ away**2 / weight.sum()))


def _held(parameter: Parameter, here: float, error: float) -> Array:
    """Values about the fit, closer together the nearer they are."""
    width = parameter.high - parameter.low
    away = SIGMAS * error if SIGMAS[-1] * error < width else AWAY * width
    return np.unique(np.clip([here, *(here - away), *(here + away)], *parameter.search))


def _widths(axis: Array) -> Array:
    """What each value stands for: halfway to its neighbours."""
    edges = np.concatenate([axis[:1], 0.5 * (axis[1:] + axis[:-1]), axis[-1:]])
    return np.asarray(np.diff(edges)) if len(axis) > 1 else np.ones(1)
