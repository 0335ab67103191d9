"""What is odd about trials, before any verdict: what can't be is refused, what may be wrong is said in a line each.

The lines are notes for a reader; no trial is left out for them.
"""

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT
from sandbot_model.data.clustering import conditions, phi_levels, widest_scatter
from sandbot_model.data.distributions import t_sf
from sandbot_model.data.regime import SURE_LIFT_M, WALKING_LIFT_M, walks
from sandbot_model.data.rounding import rounding_step
from sandbot_model.physics.gait import clock
from sandbot_model.physics.geometry import deepest_m
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.order import began_at
from sandbot_record.trials.table import OK, Trials, check_usable

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PHI_LOW, PHI_HIGH = 0.5, 0.7
"""Volume fractions that a bed of grains at rest can have."""
TOO_FAR = (2.0, 1.25, 1.25, 2.0)
"""Times what legs can do, of each observable, from which trials are named. A slope of 2° adds 18 % to the pace; a body
that coasts on at the pace of its legs till the next step gets π/2 times as far; nothing lifts it any higher.
"""
FAR_TOO_FAR = 3.0
"""The same, from which a table is refused: another unit is 2π times at least (Hz for rad/s). What lies between may be
another robot's, which a verdict doubts (``plausibility``).
"""
SLIPS = 0.1
"""Share of such values up to which they are named as slips of single trials, and not refused as a column's unit."""
AT_MOST = ("2Rω/π", "2R - h", "Rω at the fastest phase of the gait", "2R")
"""What legs can do, of each observable. In a step a leg of radius R carries the body by its own chord, 2R, at most; two
steps take a period 2π/ω. It lifts it from lying on its belly to standing on the legs; and a foot that stays where it is
moves the body at the pace of the leg."""
LOW_PEAK, MOST = 0.9, 0.8
"""Peak speed over mean speed below which one of the two is something else, where it is so in most trials."""
FAST = 60.0
"""Frequency of legs [rad/s] above which a plan allows none."""
APPROVING = frozenset(
    {"good", "fine", "okay", "yes", "y", "true", "1", "valid", "done", "success", "complete", "passed"}
)
"""A status, in small letters, by which its writer may have meant "ok"."""
MANY = 64
"""Trials of a cell up to which all pairs are compared."""
FAR_OUT = 8.0
"""Distance to every other replicate, in standard deviations of one trial, from which a trial is named."""
CLEARLY = 4.0
"""Times the least lift of a walker from which no replicate of the same condition swims."""
COARSE = 0.5
"""Step of rounding over scatter from which replicates show the rounding, not the noise."""
RUNS_BACK = 0.1
"""Share of trials that are as far below 0 as others are above from which they are no outliers."""
WALKED = 0.1
"""Share of the most that legs can do from which a robot has moved: of one that is stuck half are read as below 0."""
A_FEW = 2
"""Of a small table so many may be outliers, whatever their share."""
WIDE = 0.0015
"""Scatter of φ within a level beyond what a prepared bed misses its target by (it is 0.0005 to 0.001)."""
TREND_P = 1e-3
"""p-value from which a trend along the run order is named: four observables, less than one clean campaign in 200."""
MOST_NAMED = 5


def checked(trials: Trials, where: str = "trials") -> tuple[str, ...]:
    """The notes on the usable trials. Raises InputError where their numbers make no sense as what they are called;
    ``where`` opens its line.
    """
    check_usable(trials, where)
    used = trials.select(trials.usable)
    values = np.stack([getattr(used, observable.column) for observable in Observable], axis=-1)
    share = _beyond(used, values)
    try:
        _refuse(used, share)
        _refuse_backwards(used, values)
        _refuse_runs_back(used, values, share)
        _refuse_low_peaks(used, values)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    cell, _ = conditions(used.phi, used.gait, used.omega_rad_s)
    return (
        *trials.unread,
        *_meant_ok(trials),
        *_copied(used, values),
        *_fast(used),
        *_too_far(used, share),
        *_no_peaks(values),
        *_zeros(values),
        *_classes(used),
        *_far_out(used, values, cell),
        *_coarse(values, cell),
        *_trends(used, values, cell),
        *_nameless(used, "gait", "such trials"),
        *_nameless(used, "batch", "those of its condition"),
        *_unordered(used),
    )


def _refuse(used: Trials, share: Floats) -> None:
    # A single one would be a level of its own, with a k, and trials would be proposed there.
    outside = (used.phi < PHI_LOW) | (used.phi > PHI_HIGH)
    if outside.any():
        void = 1 - used.phi[outside]
        porosity = "; is it the porosity? then phi = 1 - value" if (void[0] > PHI_LOW) & (void[0] < PHI_HIGH) else ""
        raise InputError(
            f"phi is {used.phi[outside][0]:g} in {used.trial_id[outside][0]}: grains at rest fill "
            f"{PHI_LOW:g} to {PHI_HIGH:g} of the volume{porosity}"
        )
    error_bar = used.speed_sd_m_s > np.abs(used.speed_m_s).max()
    if 2 * error_bar.sum() > np.isfinite(used.speed_sd_m_s).sum():
        raise InputError(
            f"speed_sd_m_s is {used.speed_sd_m_s[error_bar][0]:g} in {used.trial_id[error_bar][0]}, more than "
            "any speed: is it in cm/s (divided by 100)?"
        )
    for observable in Observable:
        far = share[:, observable] > FAR_TOO_FAR
        if far.sum() > SLIPS * np.isfinite(share[:, observable]).sum():
            raise InputError(_impossible(used, observable, int(np.argmax(far)), share))


def _refuse_backwards(used: Trials, values: Floats) -> None:
    """Most of a column below 0: no gait walks backwards, and none lowers the body, but for a zero that is off."""
    for observable in Observable:
        least = -SURE_LIFT_M if observable is Observable.lift else 0.0
        below = values[:, observable] < least
        if 2 * below.sum() > (count := np.isfinite(values[:, observable]).sum()):
            row, axis = int(np.argmax(below)), "up" if observable is Observable.lift else "the way the robot walks"
            raise InputError(
                f"{observable.column} is {values[row, observable]:g} in {used.trial_id[row]} and below 0 in "
                f"{below.sum()} of {count}: does its axis point {axis}? else times -1"
            )


def _refuse_runs_back(used: Trials, values: Floats, share: Floats) -> None:
    """Some of a column as far below 0 as others are above; a lift of less than nothing is a zero that is off."""
    for observable in (one for one in Observable if one is not Observable.lift):
        told = np.isfinite(column := values[:, observable])
        if not told.any():
            continue
        back = (column < -0.5 * np.median(np.abs(column[told]))) & (share[:, observable] > WALKED)
        if back.sum() > max(RUNS_BACK * told.sum(), A_FEW):
            row = int(np.argmax(back))
            raise InputError(
                f"{observable.column} is {column[row]:g} in {used.trial_id[row]} and as far below 0 in "
                f"{back.sum()} of {told.sum()} as above in others: were these runs back? then times -1"
            )


def _refuse_low_peaks(used: Trials, values: Floats) -> None:
    """Nearly all peaks below the mean. Of some that may be true: mean and peak are seen in different steps."""
    peak, mean = values[:, Observable.peak_speed], values[:, Observable.speed]
    low = peak < LOW_PEAK * mean
    if low.sum() > MOST * (count := np.isfinite(peak).sum()):
        raise InputError(
            f"peak_speed_m_s is {peak[low][0]:g} and speed_m_s {mean[low][0]:g} in {used.trial_id[low][0]}, "
            f"and below the mean in {low.sum()} of {count}: are the columns exchanged?"
        )


def _no_peaks(values: Floats) -> list[str]:
    """Trials that moved, with a peak of exactly 0."""
    none = (values[:, Observable.peak_speed] == 0) & (values[:, Observable.speed] > 0)
    return (
        [f"{none.sum()} peak_speed_m_s of trials that moved are exactly 0; not measured is empty"] if none.any() else []
    )


def _fast(used: Trials) -> list[str]:
    """Legs faster than those of any such robot."""
    fast = used.omega_rad_s > FAST
    if not fast.any():
        return []
    return [
        f"omega_rad_s is {used.omega_rad_s[fast][0]:g} in {used.trial_id[fast][0]} and above {FAST:g} in {fast.sum()} "
        "trials: is it in rpm (times π/30)?"
    ]


def _beyond(used: Trials, values: Floats) -> Floats:
    """What was measured over the most that legs can do ``(trials, 4)``; NaN where it was not measured."""
    robot = used.robot or SANDBOT
    turns, pace, whole = clock([*used.gait]), robot.leg_radius_m * used.omega_rad_s, np.ones(len(used))
    fastest = pace * np.maximum(turns.slow_ratio, turns.swing_ratio)
    most = [2 * pace / np.pi, deepest_m(robot) * whole, fastest, 2 * robot.leg_radius_m * whole]
    return np.asarray(np.abs(values) / np.stack(most, axis=-1))


def _impossible(used: Trials, observable: Observable, row: int, share: Floats) -> str:
    """One value, what there can be in its place, and what may have happened to it."""
    value, radius = getattr(used, observable.column)[row], (used.robot or SANDBOT).leg_radius_m
    paced = "omega in Hz (times 2π), " if observable.unit == "m/s" else ""
    return (
        f"{observable.column} is {value:g} in {used.trial_id[row]}, where legs of {radius:g} m at "
        f"{used.omega_rad_s[row]:g} rad/s reach {abs(value) / share[row, observable]:.2g} {observable.unit} at most "
        f"({AT_MOST[observable]}); is {paced}the {observable.name.replace('_', ' ')} in {observable.readers_unit} "
        "(divided by 100), or the robot another (--robot FILE.yaml)?"
    )


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


def _too_far(used: Trials, share: Floats) -> list[str]:
    """Values that legs can't reach, where most of a column are such that they can."""
    found = []
    for observable in Observable:
        if count := int((share[:, observable] > TOO_FAR[observable]).sum()):
            worst = int(np.nanargmax(share[:, observable]))
            found.append(f"{count} of {observable.column} can't be: {_impossible(used, observable, worst, share)}")
    return found


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


def _classes(used: Trials) -> list[str]:
    """Where φ has no clear levels."""
    level = phi_levels(used.phi)
    widest = widest_scatter(used.phi, level)
    if widest <= WIDE:
        return []
    return [
        f"phi has no clear levels: its trials are gathered into {level.max() + 1} classes within which it "
        f"scatters by up to {widest:.4f}; each has a k of its own, and what φ does within one is taken out"
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
        step, scatter = rounding_step(column), _within(column, cell)
        if scatter > 0 and step > COARSE * scatter:
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


def _meant_ok(trials: Trials) -> list[str]:
    """Trials left out by a status that may well mean "ok"."""
    statuses = trials.status.tolist()
    meant = [one for one in statuses if one != OK and (one.lower() in APPROVING or one.lower().startswith(OK))]
    if not meant:
        return []
    return [f"{len(meant)} trials are left out by their status, {_some(list(dict.fromkeys(meant)))}: only ok is ok"]


def _nameless(used: Trials, column: str, others: str) -> list[str]:
    """Trials that name no batch or no gait among those that do."""
    none = [*used.trial_id[getattr(used, column) == ""]]
    if not none or len(none) == len(used):
        return []
    return [f"{len(none)} trials name no {column}, each is taken with {others} alone: {_some(none)}"]


def _unordered(used: Trials) -> list[str]:
    """Where run order or time is given for some trials only."""
    numbered = np.isfinite(used.run_order)
    if numbered.all():
        return []
    if numbered.any():
        missing = [*used.trial_id[~numbered]]
        return [f"the run order is not used, for {len(missing)} of {len(used)} trials have none: {_some(missing)}"]
    told = [(name, one) for name, one in zip(used.trial_id.tolist(), used.started.tolist(), strict=True)]
    if not any(one for _, one in told):
        return []
    if nothing := [name for name, one in told if not one]:
        return [f"started tells no order, for {len(nothing)} of {len(used)} trials have none: {_some(nothing)}"]
    name, one = next(((name, one) for name, one in told if began_at(one) is None), told[0])
    return [f"started tells no order: {one!r} in {name} is not as 2026-05-04T08:10, always or never with a zone"]


def _some(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
