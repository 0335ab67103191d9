"""Profile likelihood: the deviance at given values of some parameters, everything else fitted again at each.

A threshold between two conditions acts alike wherever it is: the deviance is a staircase, a derivative along it knows
no error or a wrong one, and so it is with other parameters, which jump with it. Where the profile along a parameter is
no parabola, or a bound is near, errors are taken from the profile over it and all others of its effect: the rms
distance from the fit, each point with weight exp(-ΔD/2) under a flat prior.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import chain

import numpy as np

from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import point_at
from sandbot_model.fitting.levenberg_marquardt import TOLERANCE, descend, put
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States, joined
from sandbot_model.fitting.walked import COUNTS, FALLEN, ITERATIONS, SHOWS, walked
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
UNLIKE = 2.0
"""Factor by which the rise of the deviance may fall short of a parabola's."""
CLIFF = 4.0
"""Factor by which it may exceed a parabola's."""
FARTHER = 4
"""How often the end of a grid is moved twice as far away until the deviance has risen there."""

TOGETHER = 3
"""Parameters of one effect that share a grid, at most: four, with up to 19 values each, have 10⁵ points and 9 GB."""


def profile(problem: Problem, start: States, at: Sequence[int], values: Array) -> States:
    """The best fit with the parameters θ[at] held at each row of ``values (rows, len(at))``, from one state."""
    rows = np.zeros(len(values), dtype=np.int64)
    theta = start.theta[rows].copy()
    theta[:, at] = values
    begin = problem.states(theta, start.ln_k[rows], start.slope[rows], problem.bed(start))
    return descend(problem, begin, ITERATIONS, fixed=at)


def deepest(fit: Fit) -> Fit:
    """The same fit at the lowest place of its profiles: along a staircase a descent stops on any stair."""
    for index in chain.from_iterable(_fitted_together(fit)):
        for _ in range(MOVES):
            states = _over_grid(fit.problem, fit, _axes(fit.problem, fit, [index]), [index])
            before, fit = fit, _at_lowest(fit, states)
            if fit is before:
                break
    return fit


def lowest_along(fit: Fit) -> Fit:
    """The same fit at the lowest place of walks along each of its parameters."""
    for index in chain.from_iterable(_fitted_together(fit)):
        fit = _at_lowest(fit, walked(fit.problem, _begin(fit.problem, fit), index, fit.stderr[index]))
    return fit


def _at_lowest(fit: Fit, states: States) -> Fit:
    """The fit that the lowest of these descends to, or the same where it gains nothing."""
    best = states.lowest()
    if best.deviance[0] > fit.deviance - GAINED:
        return fit
    end = descend(fit.problem, best)
    return fitted_at(fit.model, fit.cells, point_at(fit.problem, end), fit.nuisances)


@lru_cache(maxsize=32)
def with_profiled_errors(fit: Fit, problem: Problem | None = None) -> Fit:
    """The same fit; where the deviance along a parameter is no parabola, errors are those of a profile.

    ``problem`` may have more in it that trials share than the fit's own.
    """
    problem = problem or fit.problem
    own, spread = fit.stderr.copy(), np.zeros(len(fit.stderr))
    for at in _fitted_together(fit):
        if not all(_parabolic(problem, fit, index) for index in at):
            # What is held scatters over the grid alone, all else about each point of it as well.
            own[at] = 0.0
            spread = np.fmax(spread, _profiled(problem, fit, at))
    return replace(fit, stderr=np.sqrt(own**2 + spread**2)) if spread.any() else fit


def _fitted_together(fit: Fit) -> list[list[int]]:
    """Where the parameters of each effect stand, and Δt and v_swim by themselves where data determine them."""
    groups: dict[str, list[int]] = {}
    for at, name in enumerate(fit.model.names):
        if name not in fit.model.held and ("." in name or fit.stderr[at] > 0):
            groups.setdefault(name.partition(".")[0], []).append(at)
    return list(groups.values())


def _parabolic(problem: Problem, fit: Fit, index: int) -> bool:
    """Whether two standard errors away along a parameter, or as far as it may go, the deviance has risen as they say.

    Where it rises far faster there is a cliff.
    """
    here, error = fit.point.theta[index], fit.stderr[index]
    if not error > 0:
        return False
    values = np.clip(here + error * np.array([0.0, -2.0, 2.0]), *fit.model.parameters[index].search)
    away = (values[1:] - here) / error
    if (np.abs(away) < 1.0).any():
        return False
    deviance = profile(problem, _begin(problem, fit), [index], values[:, None]).deviance
    rise = (deviance[1:] - deviance[0]) / away**2
    return bool((rise > 1 / UNLIKE).all() and (rise < CLIFF).all())


def _profiled(problem: Problem, fit: Fit, at: Sequence[int]) -> Array:
    """How far unknowns scatter over the profile of some parameters; of more than a grid holds, of each by itself, the
    widest."""
    if len(at) > TOGETHER:
        return np.asarray(np.fmax.reduce([_profiled(problem, fit, [index]) for index in at]))
    if len(at) == 1:
        states = walked(problem, _begin(problem, fit), at[0], fit.stderr[at[0]])
        axes = [states.theta[:, at[0]]]
    else:
        axes, states = _gone_over(problem, fit, at)
    volume = np.prod(np.meshgrid(*map(_widths, axes), indexing="ij"), axis=0).ravel()
    weight = volume * np.exp(-0.5 * (states.deviance - states.deviance.min()))
    away = np.concatenate([states.theta - fit.point.theta, states.ln_k - fit.point.ln_k], axis=1)
    return np.asarray(np.sqrt(weight @ away**2 / weight.sum()))


def _gone_over(problem: Problem, fit: Fit, at: Sequence[int]) -> tuple[list[Array], States]:
    """A grid over some parameters that ends where the deviance has risen, and the profile there."""
    axes = _axes(problem, fit, at)
    states = _over_grid(problem, fit, axes, at)
    for _ in range(FARTHER):
        wider = _wider(fit, axes, at, states.deviance)
        if all(map(np.array_equal, wider, axes)):
            break
        axes, states = wider, _over_grid(problem, fit, wider, at, states)
    return axes, states


def _axes(problem: Problem, fit: Fit, at: Sequence[int]) -> list[Array]:
    named = fit.model.parameters
    return [_held(named[index], fit.point.theta[index], _scale(problem, fit, index)) for index in at]


def _scale(problem: Problem, fit: Fit, index: int) -> float:
    """How far along a parameter the deviance begins to show it: its standard error, or, where that is the curvature at
    the brink of a cliff, many times more."""
    error, width = fit.stderr[index], fit.model.parameters[index].width
    if not 0 < error < width:
        return float(error)
    away = error * 2.0 ** np.arange(-1, np.ceil(np.log2(width / error)) + 1)
    values = fit.point.theta[index] + np.concatenate([[0.0], -away, away])
    values = np.clip(values, *fit.model.parameters[index].search)
    deviance = profile(problem, _begin(problem, fit), [index], values[:, None]).deviance
    shown = np.concatenate([away, away])[(deviance - deviance.min())[1:] > SHOWS]
    return float(shown.min(initial=width))


def _wider(fit: Fit, axes: Sequence[Array], at: Sequence[int], deviance: Array) -> list[Array]:
    """Axes with one value more, twice as far away, at each end where the deviance has not risen yet.

    A valley that is flat beyond a few of its own standard errors is wider than they say.
    """
    risen = (deviance - deviance.min() > FALLEN).reshape([len(axis) for axis in axes])
    wider = []
    for which, (axis, index) in enumerate(zip(axes, at, strict=True)):
        ends = axis[[0, -1]]
        along = np.moveaxis(risen, which, 0)[[0, -1]].reshape(2, -1)
        low = ends[~along.all(axis=1)]
        beyond = np.clip(2 * low - fit.point.theta[index], *fit.model.parameters[index].search)
        wider.append(np.unique(np.concatenate([axis, beyond])))
    return wider


def _begin(problem: Problem, fit: Fit) -> States:
    return problem.states(fit.point.theta[None], fit.point.ln_k[None], fit.point.slope[None])


def _over_grid(
    problem: Problem, fit: Fit, axes: Sequence[Array], at: Sequence[int], known: States | None = None
) -> States:
    """The profile at every point of a grid; some of them may be ``known``."""
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(at))
    begin, shape = _begin(problem, fit), [len(axis) for axis in axes]
    if known is None:
        return _from_neighbours(problem, profile(problem, begin, at, grid), at, shape)
    places = {tuple(values): row for row, values in enumerate(known.theta[:, at].tolist())}
    rows = np.array([places.get(tuple(values), -1) for values in grid.tolist()])
    new = rows < 0
    rows[new] = len(known.theta) + np.arange(np.count_nonzero(new))
    both = joined([known, profile(problem, begin, at, grid[new])])
    return _from_neighbours(problem, both.take(rows), at, shape)


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
    width = parameter.width
    away = SIGMAS * error if SIGMAS[-1] * error < width else AWAY * width
    return np.unique(np.clip([here, *(here - away), *(here + away)], *parameter.search))


def _widths(axis: Array) -> Array:
    """What each value stands for: halfway to its neighbours."""
    edges = np.concatenate([axis[:1], 0.5 * (axis[1:] + axis[:-1]), axis[-1:]])
    return np.asarray(np.diff(edges)) if len(axis) > 1 else np.ones(1)
