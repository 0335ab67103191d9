"""Starting points: a coarse sample of the shared parameters, with every k profiled out.

The deviance has many minima: where the model swims it is flat, and at every cell that crosses a switch it has a step.
For given shared parameters, though, each level's k is a one-dimensional problem of its own. One table of predictions
over (θ, k, ω) serves all levels; between two nodes of the k grid the residual is taken as linear, so that the minimum
is known in closed form:

    q(t) = |(1 - t) r_0 + t r_1|²,   t* = (S_00 - S_01)/(S_00 - 2 S_01 + S_11) in [0, 1]
"""

from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.fitting.levenberg_marquardt import NOT_SEARCHED
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.geometry import critical_k_n_per_m
from sandbot_model.physics.model import Model

K_GRID = 48
K_RANGE = (0.55, 4.0)
"""k over mg/(2R - h): from ground that by a linear law never carries the robot, to effectively rigid ground."""
CHUNK = 8
MIN_DISTANCE = 0.15
"""Starts closer than this in every parameter, as a fraction of its plausible range, count as the same."""
MAX_STARTS = 12
"""Most starts from which descents begin."""
NEAR_DELTA_T = 1.45
"""Factor to either side of the Δt found within which a second sample is drawn."""
RESAMPLED = 24
"""Points of that sample for each of its dimensions."""


@dataclass(frozen=True)
class Start:
    """Start of a descent: θ ``(parameters,)``, ln k ``(levels,)`` and the coarse deviance there."""

    theta: Floats
    ln_k: Floats
    deviance: float


def starts(problem: Problem, slope: Floats, k_curve: Floats, also: Floats | None = None) -> list[Start]:
    """The most promising distinct points of a wide low-discrepancy sample, best first.

    ``k_curve (levels,)`` is the k(φ) given to effects that ask for it; ``also (m, parameters)`` are further points.
    """
    model = problem.model
    k_grid = critical_k_n_per_m(model.robot) * np.geomspace(*K_RANGE, K_GRID)
    unit = _samples(model)
    if also is not None:
        unit = np.concatenate([_unit(model, also), unit])
    return _distinct(model, _profile_all(problem, unit, slope, k_curve, k_grid), MAX_STARTS)


def resample(problem: Problem, theta: Floats, ln_k: Floats, slope: Floats) -> list[Start]:
    """Starts with Δt near that of θ ``(parameters,)`` and the effects' parameters anywhere in their ranges.

    A switch shows only in a narrow range of an effect's parameters, which a sample misses unless Δt is nearly right.
    """
    model = problem.model
    at = [i for i, name in enumerate(model.names) if "." in name]
    if not at:
        return []
    unit = np.repeat(_unit(model, theta)[None], RESAMPLED * (len(at) + 1), axis=0)
    sample = _low_discrepancy(len(unit), len(at) + 1)
    unit[:, at] = sample[:, :-1]
    clock = model.names.index("delta_t_s")
    unit[:, clock] += np.log(NEAR_DELTA_T) * (2 * sample[:, -1] - 1) / _width(model)[clock]
    k = np.exp(ln_k)
    k_grid = _narrowed(k, critical_k_n_per_m(model.robot) * np.geomspace(*K_RANGE, K_GRID))
    return _distinct(model, _profile_all(problem, unit, slope, k, k_grid), MAX_STARTS // 2)


def _distinct(model: Model, sample: "_Profiled", most: int) -> list[Start]:
    chosen: list[int] = []
    for index in np.argsort(sample.deviance):
        if all(np.abs(sample.unit[index] - sample.unit[other]).max() > MIN_DISTANCE for other in chosen):
            chosen.append(int(index))
        if len(chosen) == most:
            break
    return [Start(_theta(model, sample.unit[i]), sample.ln_k[i], float(sample.deviance[i])) for i in chosen]


@dataclass(frozen=True, eq=False)
class _Profiled:
    """Points in unit coordinates ``(m, parameters)`` with their profiled deviance and ln k."""

    unit: Floats
    deviance: Floats
    ln_k: Floats


def _profile_all(problem: Problem, unit: Floats, slope: Floats, k_curve: Floats, k_grid: Floats) -> _Profiled:
    theta = _theta(problem.model, unit)
    parts = [profile(problem, theta[i : i + CHUNK], slope, k_curve, k_grid) for i in range(0, len(theta), CHUNK)]
    return _Profiled(unit, *(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _narrowed(k: Floats, k_grid: Floats) -> Floats:
    """A grid of equally many nodes, but only over the part of the grid in which ``k (levels,)`` lie."""
    inside = k[k > k_grid[0] * 1.02]
    if not len(inside):
        return k_grid
    return np.geomspace(max(inside.min() * 0.93, k_grid[0]), min(inside.max() * 1.07, k_grid[-1]), len(k_grid))


def profile(problem: Problem, theta: Floats, slope: Floats, k_curve: Floats, k_grid: Floats) -> tuple[Floats, Floats]:
    """Deviance minimised over all k for each θ ``(m, parameters)``, ``(m,)``, and the ln k there ``(m, levels)``."""
    same = np.zeros((len(theta), len(problem.cells.level_phi), len(k_grid)))
    cross = np.zeros((*same.shape[:2], len(k_grid) - 1))
    if problem.cells.pressed is not None:
        missed, level = _pressed_table(problem, theta, k_grid, slope), problem.cells.pressed.level
        for at, each in zip(level, missed, strict=True):
            same[:, at] += each**2
            cross[:, at] += each[:, :-1] * each[:, 1:]
    deviance, k = problem.cell_means.profiled(theta, slope, k_curve, k_grid, same, cross)
    return deviance, np.log(k)


def _pressed_table(problem: Problem, theta: Floats, k_grid: Floats, slope: Floats) -> Floats:
    """Penetrometer readings minus model in standard deviations ``(readings, m, k)``. Correlations of their errors are
    neglected: the tables are summed level by level."""
    assert problem.cells.pressed is not None
    ln_k = np.repeat(np.log(k_grid)[:, None], len(problem.cells.level_phi), axis=1)
    missed = [problem.missed_forces(np.repeat(row[None], len(k_grid), axis=0), ln_k, slope) for row in theta]
    return np.moveaxis(np.array(missed) / np.sqrt(np.diag(problem.cells.pressed.covariance)), -1, 0)


def search_box(model: Model) -> tuple[Floats, Floats]:
    """Lower and upper ends of the plausible ranges ``(parameters,)``, with ln Δt for Δt."""
    ranges = np.array([(parameter.low, parameter.high) for parameter in model.parameters])
    return _scaled(model, ranges[:, 0]), _scaled(model, ranges[:, 1])


def _scaled(model: Model, theta: Floats) -> Floats:
    scaled = np.array(theta, dtype=float)
    at = model.names.index("delta_t_s")
    scaled[..., at] = np.log(scaled[..., at])
    return scaled


def _unit(model: Model, theta: Floats) -> Floats:
    return (_scaled(model, theta) - search_box(model)[0]) / _width(model)


def _width(model: Model) -> Floats:
    """Widths of the ranges ``(parameters,)``, infinite for a held parameter, which stays at 0 in unit coordinates."""
    low, high = search_box(model)
    return np.where(high > low, high - low, np.inf)


def _theta(model: Model, unit: Floats) -> Floats:
    low, high = search_box(model)
    theta = low + unit * (high - low)
    at = model.names.index("delta_t_s")
    theta[..., at] = np.exp(theta[..., at])
    return theta


def _samples(model: Model) -> Floats:
    """A low-discrepancy sample of the plausible ranges in unit coordinates; v_swim stays at its start value."""
    free = [i for i, name in enumerate(model.names) if name != NOT_SEARCHED]
    count = {1: 24, 2: 56, 3: 112}.get(len(free), 144)
    unit = np.tile(_unit(model, np.array([parameter.start for parameter in model.parameters])), (count, 1))
    unit[:, free] = _low_discrepancy(count, len(free))
    return unit


def _low_discrepancy(count: int, dimensions: int) -> Floats:
    """Low-discrepancy points ``(count, dimensions)`` in the unit cube: additive recurrence with the generalised golden
    ratio; deterministic.
    """
    root = 1.5
    for _ in range(40):
        root = (1 + root) ** (1 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.mod(0.5 + np.arange(1, count + 1)[:, None] * steps, 1.0)
