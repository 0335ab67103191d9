"""Checks of trials before any verdict: impossible numbers are refused, suspicious ones are noted, one line each.

The notes are for a reader; no trial is left out because of them.
"""

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT
from sandbot_model.data.clustering import conditions, phi_levels, widest_scatter
from sandbot_model.data.distributions import t_sf
from sandbot_model.data.mean_rows import LEAST_ROWS, mean_of_columns, means_of_cells
from sandbot_model.data.regime import SURE_LIFT_M, WALKING_LIFT_M, WALKING_SPEED_M_S, lifts_cut_off, walks
from sandbot_model.data.rounding import rounding_step
from sandbot_model.physics.gait import clock
from sandbot_model.physics.geometry import deepest_m, step_from_lift
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.order import is_time
from sandbot_record.trials.table import OK, Trials, check_usable

PHI_LOW, PHI_HIGH = 0.5, 0.7
"""Volume fractions that a bed of grains at rest can have."""
TOO_FAR = (2.0, 1.25, 1.25, 2.0)
"""Ratio of each observable to its kinematic limit (``LIMITS``) beyond which trials are named. A slope of 2° adds 18 %
to the speed; a body that coasts at the speed of its legs till the next step gets π/2 times as far; nothing lifts it
higher."""
FAR_TOO_FAR = 3.0
"""The ratio beyond which a table is refused: a wrong unit gives at least 2π (Hz for rad/s). Smaller ratios may be due
to another robot, which the verdict doubts (``plausibility``)."""
SLIPS = 0.1
"""Fraction of such values up to which they are reported as slips in single trials; more are refused as a wrong unit."""
LIMITS = ("2Rω/π", "2R - h", "Rω at the fastest phase of the gait", "2R")
"""Kinematic limits of each observable. In a step a leg of radius R carries the body by its own chord, 2R, at most; two
steps take a period 2π/ω. It lifts the body from lying on its belly to standing on the legs; and a foot that does not
slip moves the body at the speed of the leg."""
LOW_PEAK, IN_MOST = 0.9, 0.8
"""Ratio of peak to mean speed below which a trial is suspicious, and fraction of such trials from which a table is."""
FAST = 60.0
"""Leg frequency [rad/s] above which trials are named; no plan allows more."""
APPROVING = frozenset(
    {"good", "fine", "okay", "yes", "y", "true", "1", "0", "valid", "done", "success", "complete", "passed"}
)
"""Lower-case statuses by which their writer may have meant "ok"."""
ALL_PAIRS = 64
"""Trials of a cell up to which all pairs are compared."""
FAR_OUT = 8.0
"""Distance to every other replicate, in standard deviations of one trial, from which a trial is named."""
CLEARLY_LIFTED = 4.0
"""Multiple of the least lift of a walker beyond which no replicate of the same condition swims."""
COARSE = 0.5
"""Ratio of rounding step to scatter beyond which replicates show the rounding, not the noise."""
RUNS_BACK = 0.1
"""Fraction of trials as far below 0 as others are above, beyond which they are not outliers but backward runs."""
MOVED = 0.1
"""Ratio to the kinematic limit beyond which a robot has moved; half the readings of a stuck one are below 0."""
AT_THE_END = 3
"""Ratio of the number of equal values at an end of a column to that of any other value, beyond which they are no
accident of rounding."""
LEAST_AT_THE_END = 5
NEARLY = 0.9
"""Fraction of the axles' height at rest below which no reading of that height lies."""
LOST = 0.7
"""Step from the speed over step from the lift (the geometry lock): losses leave more than this of a step."""
A_FEW = 2
"""Number of trials that may be outliers even in a small table, whatever their fraction."""
WIDE = 0.0015
"""Scatter of φ within a level that a prepared bed does not reach (it misses its target by 0.0005 to 0.001)."""
TREND_P = 1e-3
"""p-value below which a trend along the run order is named: with four observables, in less than one clean campaign in
200."""
MOST_NAMED = 5
ERROR_BARS = ("speed_sd_m_s", "speed_sem_m_s")


def checked(trials: Trials, where: str = "trials") -> tuple[str, ...]:
    """Notes on the usable trials. Raises InputError, with ``where`` in front, if a column's numbers are impossible."""
    check_usable(trials, where)
    left_out = _speedless(trials, where)
    used = trials.select(trials.usable)
    values = np.stack([getattr(used, observable.column) for observable in Observable], axis=-1)
    ratio = _ratio_to_limit(used, values)
    cell, _ = conditions(used.phi, used.gait, used.omega_rad_s)
    try:
        _refuse_impossible(used, ratio)
        _refuse_wrong_sign(used, values)
        _refuse_backward_runs(used, values, ratio)
        _refuse_low_peaks(used, values)
        _refuse_means(used, values, cell)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return (
        *trials.unread,
        *_meant_ok(trials),
        *left_out,
        *_fast(used),
        *_too_far(used, ratio),
        *_no_peaks(values),
        *_zeros(used, values),
        *_cut_off(values),
        *_ends_of_reading(used, values),
        *_axle_heights(used, values),
        *_zero_error_bars(used),
        *_no_levels(used),
        *_far_out(used, values, cell),
        *_coarse(values, cell),
        *_trends(used, values, cell),
        *_nameless(used, "gait", "are grouped only with each other"),
        *_nameless(used, "batch", "are grouped only by condition"),
        *_unordered(used),
    )


def _refuse_impossible(used: Trials, ratio: Floats) -> None:
    # Even a single one would be a level of its own, with a k, and trials would be proposed there.
    outside = (used.phi < PHI_LOW) | (used.phi > PHI_HIGH)
    if outside.any():
        void = 1 - used.phi[outside]
        porosity = "; is it the porosity? then phi = 1 - value" if (void[0] > PHI_LOW) & (void[0] < PHI_HIGH) else ""
        raise InputError(
            f"phi is {used.phi[outside][0]:g} in {used.trial_id[outside][0]}: grains at rest fill "
            f"{PHI_LOW:g} to {PHI_HIGH:g} of the volume{porosity}"
        )
    for name in ERROR_BARS:
        bars = getattr(used, name)
        wide = bars > np.abs(used.speed_m_s).max()
        if 2 * wide.sum() > np.isfinite(bars).sum():
            raise InputError(
                f"{name} is {bars[wide][0]:g} in {used.trial_id[wide][0]}, more than "
                "any speed: is it in cm/s (divided by 100)?"
            )
    barred = np.isfinite([getattr(used, name) for name in ERROR_BARS]).any()
    if barred and len(used) >= LEAST_ROWS and (np.diff(used.n_trials) == 1).all():
        raise InputError(
            f"n_trials counts from {used.n_trials[0]:g} to {used.n_trials[-1]:g}, row by row: does it number the rows? "
            "it is for the number of trials of which a row is the mean"
        )
    for observable in Observable:
        far = ratio[:, observable] > FAR_TOO_FAR
        if far.sum() > SLIPS * np.isfinite(ratio[:, observable]).sum():
            raise InputError(_impossible(used, observable, int(np.argmax(far)), ratio))


def _refuse_wrong_sign(used: Trials, values: Floats) -> None:
    """Most of a column below 0: no gait walks backwards, and none lowers the body by more than an error of the zero."""
    for observable in Observable:
        least = -SURE_LIFT_M if observable is Observable.lift else 0.0
        below = values[:, observable] < least
        if 2 * below.sum() > (count := np.isfinite(values[:, observable]).sum()):
            row, axis = int(np.argmax(below)), "up" if observable is Observable.lift else "the way the robot walks"
            raise InputError(
                f"{observable.column} is {values[row, observable]:g} in {used.trial_id[row]} and below 0 in "
                f"{below.sum()} of {count}: does its axis point {axis}? if not, multiply by -1"
            )


def _refuse_backward_runs(used: Trials, values: Floats, ratio: Floats) -> None:
    """Some of a column as far below 0 as others are above. Not for lift: a negative one is an error of the zero."""
    for observable in (o for o in Observable if o is not Observable.lift):
        measured = np.isfinite(column := values[:, observable])
        if not measured.any():
            continue
        back = (column < -0.5 * np.median(np.abs(column[measured]))) & (ratio[:, observable] > MOVED)
        if back.sum() > max(RUNS_BACK * measured.sum(), A_FEW):
            row = int(np.argmax(back))
            raise InputError(
                f"{observable.column} is {column[row]:g} in {used.trial_id[row]} and as far below 0 in "
                f"{back.sum()} of {measured.sum()} as above in others: were these runs backwards? then multiply by -1"
            )


def _refuse_low_peaks(used: Trials, values: Floats) -> None:
    """Nearly all peaks below the mean. A few may be: mean and peak are measured in different steps."""
    peak, mean = values[:, Observable.peak_speed], values[:, Observable.speed]
    low = peak < LOW_PEAK * mean
    if low.sum() > IN_MOST * (count := np.isfinite(peak).sum()):
        raise InputError(
            f"peak_speed_m_s is {peak[low][0]:g} and speed_m_s {mean[low][0]:g} in {used.trial_id[low][0]}, "
            f"and below the mean in {low.sum()} of {count}: are the columns exchanged?"
        )


def _refuse_means(used: Trials, values: Floats, cell: Ints) -> None:
    """Rows that are means of others, not trials."""
    names = used.trial_id
    leave = "leave out what is not a trial (or give it a status other than ok)"
    if rows := means_of_cells(values, cell):
        raise InputError(
            f"each condition with several trials has a row that is the mean of its others: "
            f"{_listed(names[rows].tolist())}; {leave}"
        )
    if (row := mean_of_columns(np.stack([used.phi, used.omega_rad_s], axis=-1), values)) is not None:
        raise InputError(f"{names[row]} is the mean of all other rows in every column; {leave}")


def _no_peaks(values: Floats) -> list[str]:
    """Trials that moved, with a peak of exactly 0."""
    none = (values[:, Observable.peak_speed] == 0) & (values[:, Observable.speed] > 0)
    return (
        [f"{none.sum()} peak_speed_m_s of trials that moved are exactly 0; if not measured, leave them empty"]
        if none.any()
        else []
    )


def _fast(used: Trials) -> list[str]:
    """Legs faster than any such robot's."""
    fast = used.omega_rad_s > FAST
    if not fast.any():
        return []
    return [
        f"omega_rad_s is {used.omega_rad_s[fast][0]:g} in {used.trial_id[fast][0]} and above {FAST:g} in {fast.sum()} "
        "trials: is it in rpm (times π/30)?"
    ]


def _ratio_to_limit(used: Trials, values: Floats) -> Floats:
    """Measured values over their kinematic limits ``(trials, 4)``; NaN where not measured."""
    robot = used.robot or SANDBOT
    clocks, rim_speed, ones = clock([*used.gait]), robot.leg_radius_m * used.omega_rad_s, np.ones(len(used))
    fastest = rim_speed * np.maximum(clocks.slow_ratio, clocks.swing_ratio)
    limits = [2 * rim_speed / np.pi, deepest_m(robot) * ones, fastest, 2 * robot.leg_radius_m * ones]
    with np.errstate(over="ignore"):  # legs that hardly turn reach hardly any speed
        return np.asarray(np.abs(values) / np.stack(limits, axis=-1))


def _impossible(used: Trials, observable: Observable, row: int, ratio: Floats) -> str:
    """One impossible value, its limit, and likely causes."""
    value, radius = getattr(used, observable.column)[row], (used.robot or SANDBOT).leg_radius_m
    frequency = "omega in Hz (times 2π), " if observable.unit == "m/s" else ""
    return (
        f"{observable.column} is {value:g} in {used.trial_id[row]}, where legs of {radius:g} m at "
        f"{used.omega_rad_s[row]:g} rad/s reach {abs(value) / ratio[row, observable]:.2g} {observable.unit} at most "
        f"({LIMITS[observable]}); is {frequency}the {observable.name.replace('_', ' ')} in {observable.readers_unit} "
        "(divided by 100), or is it another robot (--robot FILE.yaml)?"
    )


def _too_far(used: Trials, ratio: Floats) -> list[str]:
    """Values beyond the kinematic limit, where most of the column are within it."""
    found = []
    for observable in Observable:
        if count := int((ratio[:, observable] > TOO_FAR[observable]).sum()):
            worst = int(np.nanargmax(ratio[:, observable]))
            found.append(f"{count} impossible {observable.column}: {_impossible(used, observable, worst, ratio)}")
    return found


def _zeros(used: Trials, values: Floats) -> list[str]:
    """Observables that are exactly 0 in most trials, or in any that surely walked by another: a peak is so noted too
    (``_no_peaks``). Lifts of swimmers are 0."""
    found, walked = [], _surely_walked(used, values)
    swam = values[:, Observable.speed] <= WALKING_SPEED_M_S
    for observable in Observable:
        column = values[:, observable]
        count, zero = np.isfinite(column).sum(), column == 0
        of_walkers = zero & walked[:, observable] & (observable is not Observable.peak_speed)
        strange = zero & ~swam if observable is Observable.lift else zero
        if count and (2 * strange.sum() >= count or of_walkers.any()):
            those = f" though {of_walkers.sum()} of these trials walked" if of_walkers.any() else ""
            found.append(
                f"{zero.sum()} of {count} {observable.column} are exactly 0{those}; if not measured, leave them empty"
            )
    return found


def _cut_off(values: Floats) -> list[str]:
    """That lifts below 0 were set to 0, so that those of swimmers are not used."""
    cut, lift = lifts_cut_off(values), values[:, Observable.lift]
    if not cut.any():
        return []
    return [
        f"lift_m is exactly 0 in {(lift == 0).sum()} trials and never below, as if negative readings were set to 0: "
        "lifts of conditions that swam are not used; give all as they were read"
    ]


def _ends_of_reading(used: Trials, values: Floats) -> list[str]:
    """Observables whose smallest or largest value many walkers have, as where a scale ends; 0 is ``_zeros``'s."""
    found, walked = [], _surely_walked(used, values)
    for observable in Observable:
        column = values[:, observable]
        column = column[walked[:, observable] & np.isfinite(column)]
        each, count = np.unique(column, return_counts=True)
        for at, which in ((0, "smallest"), (-1, "largest")) if len(each) > 1 else ():
            usual = np.delete(count, at).max()
            if each[at] != 0 and count[at] >= max(AT_THE_END * usual, LEAST_AT_THE_END):
                found.append(
                    f"{observable.column} is {each[at]:g}, its {which} value, in {count[at]} trials that walked: "
                    "does the reading end there? then leave these empty"
                )
    return found


def _axle_heights(used: Trials, values: Floats) -> list[str]:
    """Lifts that never come below the height of the axles at rest, and that agree with the speeds only less that."""
    robot, lift = used.robot or SANDBOT, values[:, Observable.lift]
    at_rest = robot.axle_height_m
    least = float(np.nanmin(lift, initial=np.inf))
    walked = lift - at_rest > SURE_LIFT_M
    if not (SURE_LIFT_M < NEARLY * at_rest < least and walked.any()):
        return []
    step = np.pi * values[walked, Observable.speed] / used.omega_rad_s[walked]
    with np.errstate(divide="ignore", invalid="ignore"):  # no leg steps where the lift exceeds 2R
        as_given, as_heights = (
            float(np.median(step / step_from_lift(above[walked], robot.leg_radius_m)))
            for above in (lift, lift - at_rest)
        )
    if not as_given < LOST < as_heights:
        return []
    return [
        f"lift_m is {least:.3g} or more in all {np.isfinite(lift).sum()} trials, and too large for their speeds: is it "
        f"the height of the axles, {at_rest:g} at rest? lift is their rise above that, so subtract {at_rest:g}"
    ]


def _surely_walked(used: Trials, values: Floats) -> Bools:
    """Trials that walked, judged without each observable ``(trials, 4)``: lifted beyond an error of the zero, or faster
    than any swimmer and than a body that was lifted no more."""
    step_m = step_from_lift(np.array(SURE_LIFT_M), (used.robot or SANDBOT).leg_radius_m)
    fast = values[:, Observable.speed] > np.maximum(WALKING_SPEED_M_S, used.omega_rad_s * step_m / np.pi)
    lifted = values[:, Observable.lift] > SURE_LIFT_M
    without = {Observable.speed: lifted, Observable.lift: fast}
    return np.stack([without.get(observable, fast | lifted) for observable in Observable], axis=-1)


def _zero_error_bars(used: Trials) -> list[str]:
    """Error bars of 0 in rows that are means."""
    found = []
    for name in ERROR_BARS:
        none = (getattr(used, name) == 0) & ~np.isfinite(used.replicate)
        are = f"1 {name} is 0 and counts" if none.sum() == 1 else f"{none.sum()} {name} are 0 and count"
        found += [f"{are} as not given: {_listed(used.trial_id[none].tolist())}"] if none.any() else []
    return found


def _no_levels(used: Trials) -> list[str]:
    """Where φ has no clear levels."""
    level = phi_levels(used.phi)
    widest = widest_scatter(used.phi, level)
    if widest <= WIDE:
        return []
    return [
        f"phi has no clear levels: its trials are gathered into {level.max() + 1} classes within which it "
        f"scatters by up to {widest:.4f}; each has its own k, and the effect of φ within a class is corrected for"
    ]


def _far_out(used: Trials, values: Floats, cell: Ints) -> list[str]:
    """Trials far from every other of their cell, both as they are and as fractions of its median: noise may be constant
    or in proportion to what is measured."""
    median = np.stack([np.median(values[cell == one], axis=0) for one in range(cell.max() + 1)])[cell]
    with np.errstate(invalid="ignore", divide="ignore"):
        far = np.minimum(*(_distances(each, values, cell) for each in (values, values / np.abs(median))))
    found = []
    for observable in Observable:
        column = np.nan_to_num(far[:, observable])
        names = [f"{used.trial_id[i]} ({column[i]:.0f} sd)" for i in np.argsort(-column) if column[i] > FAR_OUT]
        if names:
            found.append(f"{observable.column} far from every other replicate: {_listed(names)}")
    return found


def _distances(scaled: Floats, values: Floats, cell: Ints) -> Floats:
    """Distance of each trial from the nearest other of its cell ``(trials, 4)``, in units of the typical scatter within
    cells; NaN where it has none."""
    walked = walks(values, CLEARLY_LIFTED * WALKING_LIFT_M)
    pairs: dict[Observable, list[float]] = {observable: [] for observable in Observable}
    nearest = np.full(values.shape, np.nan)
    for this_cell in np.unique(cell):
        inside = np.flatnonzero(cell == this_cell)
        if len(inside) < 3 or not walked[inside].all():
            continue  # where the ground hardly holds, one replicate may walk and the next swim without any mistake
        for observable in Observable:
            replicates = scaled[inside, observable]
            pairs[observable] += _gaps(replicates)
            nearest[inside, observable] = _nearest(replicates)
    for observable in Observable:
        finite = [gap for gap in pairs[observable] if np.isfinite(gap)]
        scale = float(np.median(finite)) / 0.6745 / np.sqrt(2) if finite else 0.0
        nearest[:, observable] /= scale if scale > 0 else np.nan
    return nearest


def _gaps(replicates: Floats) -> list[float]:
    """Differences between the trials of a cell: of all pairs or, if there are very many, of each with the next few."""
    count = len(replicates)
    lags = range(1, count if count <= ALL_PAIRS else ALL_PAIRS // 2)
    return [gap for lag in lags for gap in np.abs(replicates[lag:] - replicates[:-lag]).tolist()]


def _nearest(replicates: Floats) -> Floats:
    """Distance of each value from the nearest other; all NaN if one of them is."""
    order = np.argsort(replicates)
    step = np.diff(replicates[order])
    found = np.full(len(replicates), np.nan)
    if not np.isnan(replicates).any():
        found[order] = np.minimum(np.append(step, np.inf), np.append(np.inf, step))
    return found


def _coarse(values: Floats, cell: Ints) -> list[str]:
    found = []
    for observable in Observable:
        column = values[:, observable]
        step, scatter = rounding_step(column), _scatter(column, cell)
        if scatter > 0 and step > COARSE * scatter:
            found.append(f"{observable.column} is rounded to {step:.2g}, replicates scatter {scatter:.2g}")
    return found


def _scatter(column: Floats, cell: Ints) -> float:
    """Rms scatter about the cell means; 0 where nothing is replicated."""
    residual, dof = _about_cell_means(column, cell)
    return float(np.sqrt(np.nansum(residual**2) / dof)) if dof > 0 else 0.0


def _about_cell_means(column: Floats, cell: Ints) -> tuple[Floats, int]:
    """Deviations from the cell means, and their degrees of freedom."""
    finite = np.isfinite(column)
    count = np.bincount(cell, finite)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(cell, np.where(finite, column, 0.0)) / count
    return column - mean[cell], int(finite.sum() - (count > 0).sum())


def trend(column: Floats, order: Floats, cell: Ints) -> tuple[float, float]:
    """Change of a column over the whole run order, in its unit, and its p-value: a regression about cell means.

    All are ``(trials,)``. Column and order are centred on the means of the same trials, so no model and no effect of φ
    or ω enters; NaN with too few replicates.
    """
    finite = np.isfinite(column) & np.isfinite(order)
    y, dof = _about_cell_means(np.where(finite, column, np.nan), cell)
    x, _ = _about_cell_means(np.where(finite, order, np.nan), cell)
    x, y = x[finite], y[finite]
    information = float(x @ x)
    if dof < 4 or information <= 0:
        return float("nan"), float("nan")
    slope = float(x @ y) / information
    error = float(np.sqrt(max(np.sum((y - slope * x) ** 2), 1e-300) / (dof - 1) / information))
    span = float(np.ptp(order[finite]))
    return slope * span, float(2 * t_sf(abs(slope / error), dof - 1))


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
    """Trials left out because of a status that may well mean "ok"."""
    statuses = trials.status.tolist()
    meant = [text for text in statuses if text != OK and (text.lower() in APPROVING or text.lower().startswith(OK))]
    if not meant:
        return []
    listed = _listed(list(dict.fromkeys(meant)))
    return [f"{len(meant)} trials are left out because of their status, {listed}: only ok is used"]


def _speedless(trials: Trials, where: str) -> list[str]:
    """Trials left out for want of a speed. Raises InputError if they are most of those that are ok."""
    ok = trials.status == OK
    none = [*trials.trial_id[ok & np.isnan(trials.speed_m_s)]]
    if 2 * len(none) > ok.sum():
        raise InputError(
            f"{where}: speed_m_s is not given in {len(none)} of {ok.sum()} trials: {_listed(none)}; it is needed of a "
            "trial (or a status other than ok)"
        )
    are = "trial is" if len(none) == 1 else "trials are"
    return [f"{len(none)} {are} left out, as no speed_m_s is given: {_listed(none)}"] if none else []


def _nameless(used: Trials, column: str, grouping: str) -> list[str]:
    """Trials without a batch or a gait, if others have one."""
    none = [*used.trial_id[getattr(used, column) == ""]]
    if not none or len(none) == len(used):
        return []
    return [f"{len(none)} trials name no {column} and {grouping}: {_listed(none)}"]


def _unordered(used: Trials) -> list[str]:
    """Where run order or time is given for some trials only."""
    numbered = np.isfinite(used.run_order)
    if numbered.all():
        alike = len(used) > 1 and not np.ptp(used.run_order) > 0
        return ["run_order (or started) is the same in all trials and gives no order"] if alike else []
    if numbered.any():
        missing = [*used.trial_id[~numbered]]
        return [f"the run order is not used, for {len(missing)} of {len(used)} trials have none: {_listed(missing)}"]
    times = [(name, time) for name, time in zip(used.trial_id.tolist(), used.started.tolist(), strict=True)]
    if not any(time for _, time in times):
        return []
    if missing := [name for name, time in times if not time]:
        return [f"started gives no order, for {len(missing)} of {len(used)} trials have none: {_listed(missing)}"]
    name, time = next(((name, time) for name, time in times if not is_time(time)), times[0])
    return [f"started gives no order: {time!r} in {name} is not like 2026-05-04T08:10, all in one notation and zone"]


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
