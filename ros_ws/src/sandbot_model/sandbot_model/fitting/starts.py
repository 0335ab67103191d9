"""Where to start: a coarse look at all shared parameters, with every k profiled exactly.

The deviance has many minima: where the model swims it is flat, and every cell that crosses a switch makes a step. For
given shared parameters, though, each level's k is a problem of its own in one dimension. So one table of predictions
over (θ, k, ω) serves all levels, and between two nodes of the k grid the residual is taken as linear, whose minimum
is known:

    q(t) = |(1 - t) r_0 + t r_1|²,   t* = (S_00 - S_01)/(S_00 - 2 S_01 + S_11) in [0, 1]
"""

from dataclasses import dataclass

import numpy as np

from sandbot_model.fitting.levenberg_marquardt import FOUND_AT_ONCE
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.geometry import critical_k_n_per_m
from sandbot_model.physics.model import Model

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
    clock = model.names.index("delta_t_s")
    unit[:, clock] += np.log(NEAR_DELTA_T) * (2 * sample[:, -1] - 1) / _width(model)[clock]
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
    same = np.zeros((len(theta), len(problem.cells.level_phi), len(k_grid)))
    cross = np.zeros((*same.shape[:2], len(k_grid) - 1))
    if problem.cells.pressed is not None:
        missed, level = _pressed_table(problem, theta, k_grid, slope), problem.cells.pressed.level
        for at, each in zip(level, missed, strict=True):
            same[:, at] += each**2
            cross[:, at] += each[:, :-1] * each[:, 1:]
    deviance, k = problem.cell_means.profiled(theta, slope, k_curve, k_grid, same, cross)
    return deviance, np.log(k)


def _pressed_table(problem: Problem, theta: Array, k_grid: Array, slope: Array) -> Array:
    """Penetrometer readings minus model in standard deviations ``(readings, m, k)``, as if they shared nothing: every
    level has its own k, and only these tables are added up."""
    assert problem.cells.pressed is not None
    ln_k = np.repeat(np.log(k_grid)[:, None], len(problem.cells.level_phi), axis=1)
    missed = [problem.missed_forces(np.repeat(row[None], len(k_grid), axis=0), ln_k, slope) for row in theta]
    return np.moveaxis(np.array(missed) / np.sqrt(np.diag(problem.cells.pressed.covariance)), -1, 0)


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
    return (_scaled(model, theta) - search_box(model)[0]) / _width(model)


def _width(model: Model) -> Array:
    """Widths of the ranges ``(parameters,)``, infinite for one that is held: it stays at 0 in unit coordinates."""
    low, high = search_box(model)
    return np.where(high > low, high - low, np.inf)


def _theta(model: Model, unit: Array) -> Array:
    low, high = search_box(model)
    theta = low + unit * (high - low)
    at = model.names.index("delta_t_s")
    theta[..., at] = np.exp(theta[..., at])
    return theta


def _samples(model: Model) -> Array:
    """An even sample of the plausible ranges in unit coordinates; v_swim, found by any descent, at its start."""
    free = [i for i, name in enumerate(model.names) if name != FOUND_AT_ONCE]
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
