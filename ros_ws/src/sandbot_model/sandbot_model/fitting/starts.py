"""Where to start: a coarse look at all shared parameters, with every k profiled exactly.

The deviance has many minima: where the model swims it is flat, and every cell that crosses a switch makes a step. For
given shared parameters, though, each level's k is a problem of its own in one dimension. So one table of predictions
over (θ, k, ω) serves all levels, and between two nodes of the k grid the residual is taken as linear, whose minimum
is known:

    q(t) = |(1 - t) r_0 + t r_1|²,   t* = (S_00 - S_01)/(S_00 - 2 S_01 + S_11) in [0, 1]
"""

from dataclasses import astuple, dataclass

import numpy as np

from sandbot_model.fitting.averaging import NODES, WEIGHTS
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.points import Conditions, Points
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.geometry import critical_k_n_per_m
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES, Observable
from sandbot_model.physics.walking import KCurve

K_GRID = 48
K_RANGE = (0.55, 4.0)
"""k over mg/(2R - h): from ground that never carries the robot by a linear law, to ground as hard as it matters."""
CHUNK = 8
MIN_DISTANCE = 0.15
"""Starts closer than this in every parameter, as part of its plausible range, count as the same."""
MAX_STARTS = 12
"""Starts from which a descent begins."""
NEAR_DELTA_T = 1.45
"""Factor either side of the Δt found within which a second sample is drawn."""
RESAMPLED = 24
"""Points for each parameter of an effect in that sample."""


@dataclass(frozen=True)
class Start:
    """Where a descent begins: θ ``(parameters,)``, ln k ``(levels,)`` and the coarse deviance there."""

    theta: Array
    ln_k: Array
    deviance: float


def starts(problem: Problem, slope: Array, k_curve: Array, also: Array | None = None) -> list[Start]:
    """The most promising distinct points of a wide low-discrepancy sample, best first.

    ``k_curve (levels,)`` is where effects that ask for k(φ) look; ``also (m, parameters)`` are further points to try.
    """
    model = problem.model
    k_grid = critical_k_n_per_m(model.robot) * np.geomspace(*K_RANGE, K_GRID)
    unit = _samples(model)
    if also is not None:
        unit = np.concatenate([_unit(model, also), unit])
    return _distinct(model, _try(problem, unit, slope, k_curve, k_grid), MAX_STARTS)


def resample(problem: Problem, theta: Array, ln_k: Array, slope: Array) -> list[Start]:
    """Starts with Δt near what was found (θ ``(parameters,)``) and the effects' parameters anywhere in their ranges.

    A switch leaves its mark in a narrow range of its parameters that a wide sample sees only where Δt is nearly right.
    """
    model = problem.model
    at = [i for i, name in enumerate(model.names) if "." in name]
    if not at:
        return []
    unit = np.repeat(_unit(model, theta)[None], RESAMPLED * (len(at) + 1), axis=0)
    sample = _even(len(unit), len(at) + 1)
    unit[:, at] = sample[:, :-1]
    low, high = search_box(model)
    clock = model.names.index("delta_t_s")
    unit[:, clock] += np.log(NEAR_DELTA_T) * (2 * sample[:, -1] - 1) / (high - low)[clock]
    k = np.exp(ln_k)
    k_grid = _closer(k, critical_k_n_per_m(model.robot) * np.geomspace(*K_RANGE, K_GRID))
    return _distinct(model, _try(problem, unit, slope, k, k_grid), MAX_STARTS // 2)


def _distinct(model: Model, tried: "_Tried", most: int) -> list[Start]:
    chosen: list[int] = []
    for index in np.argsort(tried.deviance):
        if all(np.abs(tried.unit[index] - tried.unit[other]).max() > MIN_DISTANCE for other in chosen):
            chosen.append(int(index))
        if len(chosen) == most:
            break
    return [Start(_theta(model, tried.unit[i]), tried.ln_k[i], float(tried.deviance[i])) for i in chosen]


@dataclass(frozen=True, eq=False)
class _Tried:
    """Points in unit coordinates ``(m, parameters)`` with their profiled deviance and ln k."""

    unit: Array
    deviance: Array
    ln_k: Array


def _try(problem: Problem, unit: Array, slope: Array, k_curve: Array, k_grid: Array) -> _Tried:
    theta = _theta(problem.model, unit)
    parts = [profile(problem, theta[i : i + CHUNK], slope, k_curve, k_grid) for i in range(0, len(theta), CHUNK)]
    return _Tried(unit, *(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _closer(k: Array, k_grid: Array) -> Array:
    """A grid of as many nodes over the range of the k found."""
    inside = k[k > k_grid[0] * 1.02]
    if not len(inside):
        return k_grid
    return np.geomspace(max(inside.min() * 0.93, k_grid[0]), min(inside.max() * 1.07, k_grid[-1]), len(k_grid))


def profile(problem: Problem, theta: Array, slope: Array, k_curve: Array, k_grid: Array) -> tuple[Array, Array]:
    """The least deviance over all k for each θ ``(m, parameters)``, shape ``(m,)``, and the ln k ``(m, levels)``."""
    cells = problem.cells
    table = _table(problem, theta, k_grid, slope, k_curve)
    gap = np.where(problem.measured[:, None, None, :], cells.mean[:, None, None, :] - table, 0.0)
    residual = np.einsum("nij,nbkj->nbki", problem.whiten, gap, optimize=True)
    first = np.unique(cells.level, return_index=True)[1]
    same = np.add.reduceat(np.einsum("nbki,nbki->nbk", residual, residual), first, axis=0)
    cross = np.add.reduceat(np.einsum("nbki,nbki->nbk", residual[:, :, :-1], residual[:, :, 1:]), first, axis=0)
    if problem.cells.pressed is not None:
        missed = _pressed_table(problem, theta, k_grid, slope)
        np.add.at(same, problem.cells.pressed.level, missed**2)
        np.add.at(cross, problem.cells.pressed.level, missed[..., :-1] * missed[..., 1:])
    low, high = same[..., :-1], same[..., 1:]
    bend = low - 2 * cross + high
    t = np.clip(np.divide(low - cross, bend, out=np.zeros_like(bend), where=bend > 1e-12), 0.0, 1.0)
    value = (1 - t) ** 2 * low + 2 * t * (1 - t) * cross + t**2 * high
    best = value.argmin(axis=-1)[..., None]
    share = np.take_along_axis(t, best, axis=-1)[..., 0]
    k = k_grid[best[..., 0]] * (1 - share) + k_grid[best[..., 0] + 1] * share
    return np.take_along_axis(value, best, axis=-1)[..., 0].sum(axis=0), np.log(k).T


def _pressed_table(problem: Problem, theta: Array, k_grid: Array, slope: Array) -> Array:
    """Penetrometer readings minus model in standard deviations ``(readings, m, k)``."""
    ln_k = np.repeat(np.log(k_grid)[:, None], len(problem.cells.level_phi), axis=1)
    missed = [problem.pressed(np.repeat(row[None], len(k_grid), axis=0), ln_k, slope) for row in theta]
    return np.moveaxis(np.array(missed), -1, 0)


def _table(problem: Problem, theta: Array, k_grid: Array, slope: Array, k_curve: Array) -> Array:
    """Predictions ``(cells, m, k, 4)``; levels share them unless an effect depends on φ."""
    cells, means = problem.cells, problem.cell_means
    turning = np.stack([cells.omega, *astuple(cells.clock)])
    (omega, *clock), index = np.unique(turning, axis=1, return_inverse=True)
    phi = cells.level_phi if means.chains.uses_phi else cells.level_phi[:1]
    every_phi = np.tile(np.repeat(phi[:, None], len(omega), axis=1), (len(theta), 1))
    at = Conditions.of(problem.model.walker, omega, every_phi, Clock(*clock))
    points = Points(np.repeat(theta, len(phi), axis=0), at, k_grid[None, None], KCurve(cells.level_phi, k_curve))
    values = means.chains.values(NAMES, points, vars(means.chains.footing(points)).values())
    values = np.moveaxis(values.reshape(len(NAMES), len(theta), len(phi), len(omega), len(k_grid)), 0, -1)
    table = np.asarray(values[:, cells.level if len(phi) > 1 else np.zeros_like(cells.level), index])
    table = np.ascontiguousarray(np.moveaxis(table, 1, 0))
    if not means.chains.varies_phi:
        return table
    feet = np.full(points.shape, 0.01), np.ones(points.shape)
    sigma = means.chains.values(("sigma_phi",), points, (*feet, *feet))[0].reshape(len(theta), -1)[:, 0]
    return _averaged(table, k_grid, np.abs(slope)[cells.level][:, None] * sigma) if sigma.any() else table


def _averaged(table: Array, k_grid: Array, sigma_k: Array) -> Array:
    """The table ``(cells, m, k, 4)`` averaged along the track, σ_k ``(cells, m)`` (see ``problem``)."""
    total, peak = np.zeros_like(table), np.full(table.shape[:-1], -np.inf)
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        wanted = np.clip(k_grid + sigma_k[..., None] * node, k_grid[0], k_grid[-1])
        upper = np.clip(np.searchsorted(k_grid, wanted), 1, len(k_grid) - 1)
        share = ((wanted - k_grid[upper - 1]) / (k_grid[upper] - k_grid[upper - 1]))[..., None]
        below, above = (np.take_along_axis(table, at[..., None], axis=2) for at in (upper - 1, upper))
        value = (1 - share) * below + share * above
        total += weight * value
        if abs(node) < 2:
            peak = np.maximum(peak, value[..., Observable.peak_speed])
    total[..., Observable.lift], total[..., Observable.peak_speed] = table[..., Observable.lift], peak
    return total


def search_box(model: Model) -> tuple[Array, Array]:
    """Ends of the plausible ranges ``(parameters,)``, Δt as its logarithm."""
    ranges = np.array([(parameter.low, parameter.high) for parameter in model.parameters])
    return _scaled(model, ranges[:, 0]), _scaled(model, ranges[:, 1])


def _scaled(model: Model, theta: Array) -> Array:
    scaled = np.array(theta, dtype=float)
    at = model.names.index("delta_t_s")
    scaled[..., at] = np.log(scaled[..., at])
    return scaled


def _unit(model: Model, theta: Array) -> Array:
    low, high = search_box(model)
    return (_scaled(model, theta) - low) / (high - low)


def _theta(model: Model, unit: Array) -> Array:
    low, high = search_box(model)
    theta = low + unit * (high - low)
    at = model.names.index("delta_t_s")
    theta[..., at] = np.exp(theta[..., at])
    return theta


def _samples(model: Model) -> Array:
    """An even sample of the plausible ranges in unit coordinates; v_swim, found by any descent, at its start."""
    free = [i for i, name in enumerate(model.names) if name != "v_swim_m_s"]
    count = {1: 24, 2: 56, 3: 112}.get(len(free), 144)
    unit = np.tile(_unit(model, np.array([parameter.start for parameter in model.parameters])), (count, 1))
    unit[:, free] = _even(count, len(free))
    return unit


def _even(count: int, dimensions: int) -> Array:
    """Points ``(count, dimensions)`` in the unit cube: additive recurrence with the generalised golden ratio.

    Even in any dimension, and the same every time.
    """
    root = 1.5
    for _ in range(40):
        root = (1 + root) ** (1 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.mod(0.5 + np.arange(1, count + 1)[:, None] * steps, 1.0)
