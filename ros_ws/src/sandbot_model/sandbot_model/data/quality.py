"""What is odd about trials, before any verdict: what can't be is refused, what may be wrong is said in a line each.

The lines are notes for a reader; no trial is left out for them.
"""

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT
from sandbot_model.data.clustering import phi_levels, same_within
from sandbot_model.data.distributions import t_sf
from sandbot_model.data.regime import WALKING_LIFT_M, walks
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.table import Trials

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PHI_LOW, PHI_HIGH = 0.5, 0.7
"""Volume fractions that a bed of grains at rest can have."""
FAR_TOO_FAST = 3.0
"""Times the farthest that legs can carry a body: not another robot, but another unit (Hz for rad/s is 2π)."""
MANY = 64
"""Trials of a cell up to which all pairs are compared."""
FAR_OUT = 8.0
"""Distance to every other replicate, in standard deviations of one trial, from which a trial is named."""
CLEARLY = 4.0
"""Times the least lift of a walker from which no replicate of the same condition swims."""
COARSE = 0.5
"""Step of rounding over scatter from which replicates show the rounding, not the noise."""
WIDE = 0.002
"""Scatter of φ within a level beyond what a prepared bed misses its target by (it is 0.0005 to 0.001)."""
TREND_P = 1e-3
"""p-value from which a trend along the run order is named: four observables, less than one clean campaign in 200."""
MOST_NAMED = 5
SAME_CONDITION = 5e-3


def checked(trials: Trials) -> tuple[str, ...]:
    """The notes on the usable trials. Raises InputError where their numbers make no sense as what they are called."""
    used = trials.select(trials.usable)
    _refuse(used)
    values = np.stack([getattr(used, observable.column) for observable in Observable], axis=-1)
    cell = _cells(used)
    return (
        *_copied(used, values),
        *_zeros(values),
        *_wide_levels(used),
        *_far_out(used, values, cell),
        *_coarse(values, cell),
        *_trends(used, values, cell),
    )


def _refuse(used: Trials) -> None:
    outside = (used.phi < PHI_LOW) | (used.phi > PHI_HIGH)
    if outside.mean() > 0.5:
        porosity = "; is it the porosity? then phi = 1 - value" if ((1 - used.phi[outside]) > PHI_LOW).any() else ""
        raise InputError(
            f"trials: phi is {used.phi[outside][0]:g} in {used.trial_id[outside][0]}: grains at rest fill "
            f"{PHI_LOW:g} to {PHI_HIGH:g} of the volume{porosity}"
        )
    radius = (used.robot or SANDBOT).leg_radius_m
    fastest = 2 * radius * used.omega_rad_s / np.pi
    beyond = used.speed_m_s > FAR_TOO_FAST * fastest
    if beyond.mean() > 0.5:
        raise InputError(
            f"trials: speed_m_s is {used.speed_m_s[beyond][0]:g} in {used.trial_id[beyond][0]}, where legs of "
            f"{radius:g} m "
            f"at {used.omega_rad_s[beyond][0]:g} rad/s carry no farther than {fastest[beyond][0]:.2g} m/s (2Rω/π); "
            "is omega in Hz (times 2π) or the speed in cm/s (divided by 100)?"
        )


def _cells(used: Trials) -> Ints:
    gait = np.unique(used.gait, return_inverse=True)[1]
    keys = np.stack([phi_levels(used.phi), gait, same_within(used.omega_rad_s, SAME_CONDITION)])
    return np.asarray(np.unique(keys, axis=1, return_inverse=True)[1], dtype=np.int64)


def _copied(used: Trials, values: Floats) -> list[str]:
    """Measurements to the last digit alike in two trials: with three digits and more that is no chance."""
    seen: dict[tuple[float, ...], str] = {}
    twice = []
    for name, row in zip(used.trial_id.tolist(), values.tolist(), strict=True):
        measured = tuple(value for value in row if np.isfinite(value))
        if len(measured) < 2 and not any(len(f"{abs(value):.12g}".strip("0.")) > 4 for value in measured):
            continue
        if measured in seen:
            twice.append(f"{name} = {seen[measured]}")
        seen.setdefault(measured, name)
    return [f"{len(twice)} trials are copies of others: {_some(twice)}"] if twice else []


def _zeros(values: Floats) -> list[str]:
    found = []
    for observable in Observable:
        column = values[:, observable]
        finite = np.isfinite(column)
        if finite.any() and (column[finite] == 0).mean() >= 0.5:
            found.append(
                f"{(column == 0).sum()} of {finite.sum()} {observable.column} are exactly 0; not measured is empty"
            )
    return found


def _wide_levels(used: Trials) -> list[str]:
    level = phi_levels(used.phi)
    spread = [float(np.std(used.phi[level == index])) for index in range(int(level.max()) + 1)]
    widest = int(np.argmax(spread))
    if spread[widest] <= WIDE:
        return []
    return [
        f"phi scatters by {spread[widest]:.4f} within the level at {used.phi[level == widest].mean():.4f}: its trials "
        "are no replicates of one another, and what they scatter is not pure error"
    ]


def _far_out(used: Trials, values: Floats, cell: Ints) -> list[str]:
    """Trials far from every other of their cell, in units of what trials of a cell mostly differ by."""
    walked = walks(values, CLEARLY * WALKING_LIFT_M)
    pairs: dict[Observable, list[float]] = {observable: [] for observable in Observable}
    nearest = np.full(values.shape, np.nan)
    for this_cell in np.unique(cell):
        inside = np.flatnonzero(cell == this_cell)
        if len(inside) < 3 or not walked[inside].all():
            continue  # where the ground hardly holds, one replicate walks and the next swims: no mistake
        for observable in Observable:
            own = values[inside, observable]
            pairs[observable] += _gaps(own)
            nearest[inside, observable] = _nearest(own)
    found = []
    for observable in Observable:
        finite = [gap for gap in pairs[observable] if np.isfinite(gap)]
        scale = float(np.median(finite)) / 0.6745 / np.sqrt(2) if finite else 0.0
        if scale <= 0:
            continue
        far = nearest[:, observable] / scale
        names = [f"{used.trial_id[i]} ({far[i]:.0f} sd)" for i in np.argsort(-np.nan_to_num(far)) if far[i] > FAR_OUT]
        if names:
            found.append(f"{observable.column} far from every other replicate: {_some(names)}")
    return found


def _gaps(own: Floats) -> list[float]:
    """By how much trials of a cell differ: every pair, or of very many each with the next few."""
    many = len(own)
    lags = range(1, many if many <= MANY else MANY // 2)
    return [gap for lag in lags for gap in np.abs(own[lag:] - own[:-lag]).tolist()]


def _nearest(own: Floats) -> Floats:
    """How far each value is from the nearest other; NaN where one of them is."""
    order = np.argsort(own)
    step = np.diff(own[order])
    found = np.full(len(own), np.nan)
    if not np.isnan(own).any():
        found[order] = np.minimum(np.append(step, np.inf), np.append(np.inf, step))
    return found


def _coarse(values: Floats, cell: Ints) -> list[str]:
    found = []
    for observable in Observable:
        column = values[:, observable]
        finite = np.isfinite(column)
        steps = np.diff(np.unique(column[finite]))
        scatter = _within(column, cell)
        if finite.sum() >= 6 and len(steps) and scatter > 0:
            step = float(steps.min())
            regular = np.allclose(steps / step, np.round(steps / step), atol=1e-6)
            if regular and step > COARSE * scatter and (steps < 20 * step).mean() > 0.5:
                found.append(f"{observable.column} is rounded to {step:.2g}, replicates scatter {scatter:.2g}")
    return found


def _within(column: Floats, cell: Ints) -> float:
    """Rms scatter about the cell means; 0 where nothing is replicated."""
    residual, freedom = _about_the_mean(column, cell)
    return float(np.sqrt(np.nansum(residual**2) / freedom)) if freedom > 0 else 0.0


def _about_the_mean(column: Floats, cell: Ints) -> tuple[Floats, int]:
    finite = np.isfinite(column)
    count = np.bincount(cell, finite)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(cell, np.where(finite, column, 0.0)) / count
    return column - mean[cell], int(finite.sum() - (count > 0).sum())


def trend(column: Floats, order: Floats, cell: Ints) -> tuple[float, float]:
    """Change of a column over the whole run order, and its p-value: a regression of trials about their cell's mean.

    Both about the means of the same trials, so no model and no effect of φ or ω comes in; NaN where replicates of a
    condition were run in a row or not at all.
    """
    finite = np.isfinite(column) & np.isfinite(order)
    y, freedom = _about_the_mean(np.where(finite, column, np.nan), cell)
    x, _ = _about_the_mean(np.where(finite, order, np.nan), cell)
    x, y = x[finite], y[finite]
    information = float(x @ x)
    if freedom < 4 or information <= 0:
        return float("nan"), float("nan")
    slope = float(x @ y) / information
    error = float(np.sqrt(max(np.sum((y - slope * x) ** 2), 1e-300) / (freedom - 1) / information))
    span = float(np.ptp(order[finite]))
    return slope * span, float(2 * t_sf(abs(slope / error), freedom - 1))


def _trends(used: Trials, values: Floats, cell: Ints) -> list[str]:
    found = []
    for observable in Observable:
        change, p = trend(values[:, observable], used.run_order, cell)
        if p < TREND_P:
            found.append(
                f"{observable.column} drifts along the run order: {change:+.2g} {observable.unit} from first to last "
                f"(p = {p:.1g})"
            )
    return found


def _some(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
