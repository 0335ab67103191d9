"""Whether a robot walked or swam, judged by its measured observables."""

from collections.abc import Iterable

import numpy as np

from sandbot_common.accuracy import Accuracy
from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_common.robot import Robot
from sandbot_model.physics.gait import clock, duty, peaks_resolved, slow_phase_ratio
from sandbot_model.physics.geometry import stance_angle, step_from_lift
from sandbot_model.physics.observables import Observable

WALKING_LIFT_M = 3e-4
"""Lift above which a body was lifted by its legs: several times what tracking reads without any lift."""
SURE_LIFT_M = 4 * WALKING_LIFT_M
"""Lift beyond what a lift zero that is off by a grain can explain."""
WALKING_SPEED_M_S = 0.035
"""Clearly faster than swimming (Li09: 0.02 m/s)."""
LEAST_CUT_OFF = 3
"""Lifts of exactly 0 that are no coincidence where others are read much more finely, and none is negative."""
HELD_M = 0.01
"""A first step that is longer than a swimmer's by at least this was made on ground that held."""


def walks(values: Floats, least_lift_m: Floats | float = WALKING_LIFT_M) -> Bools:
    """Whether the robot walked ``(...)``, from measured observables ``(..., 4)``: its body was lifted by more than
    ``least_lift_m``, or, where lift was not measured, it was faster than any swimmer. If its peak speed, or where that
    was not measured its speed, was a swimmer's, its lift must exceed what an error of the lift zero can explain.
    """
    speed, lift, peak = (values[..., o] for o in (Observable.speed, Observable.lift, Observable.peak_speed))
    fastest = np.where(np.isfinite(peak), peak, speed)
    lifted = (lift > least_lift_m) & ~((fastest <= WALKING_SPEED_M_S) & (lift <= SURE_LIFT_M))
    return np.where(np.isfinite(lift), lifted, speed > WALKING_SPEED_M_S)


def swam_from_start(gaits: Iterable[str], omega: Floats, values: Floats) -> Bools:
    """Trials ``(n,)`` of values ``(n, 4)`` that swam from the first step on, in a gait with two rates.

    How far they get in it depends on when the leg passes its lowest point, and so on how it is mounted on its shaft,
    which the table does not say. A trial that swims after a first step in which the ground held does not count.
    """
    uneven = np.array([slow_phase_ratio(gait) != 1.0 for gait in gaits])
    speed, first_step = values[:, Observable.speed], values[:, Observable.first_step]
    return np.asarray(uneven & ~walks(values) & (first_step < speed * np.pi / omega + HELD_M))


def starts_on_both_tripods(gaits: Iterable[str]) -> Bools:
    """Trials ``(n,)`` in gaits whose slow phase lasts more than half a period: both tripods drive their first step.

    The second tripod is in its slow phase as the robot sets out, and takes hold again before the step is over.
    """
    turning = clock([*gaits])
    return np.asarray(~turning.one_rate & (duty(turning.slow_ratio, turning.swing_ratio) > 0.5))


def peaks_seen(
    gaits: Iterable[str], omega: Floats, values: Floats, robot: Robot, accuracy: Accuracy, rate_hz: float
) -> Bools:
    """Trials ``(n,)`` of values ``(n, 4)`` whose peak speed the cameras resolve for any stance that the lift allows."""
    return peaks_resolved(clock([*gaits]), omega, _stance_rad(values, robot, accuracy), robot.leg_mount_rad, rate_hz)


def peaks_of_some(values: Floats, cell: Ints) -> Bools:
    """Trials ``(n,)`` of values ``(n, 4)`` in conditions ``cell (n,)`` where some have a walker's peak speed and others
    swim and have none: the mean of those that have one is not what a prediction for all trials is to be held against.
    """
    peak = values[:, Observable.peak_speed]
    walker, swimmer = peak > WALKING_SPEED_M_S, ~walks(values) & np.isnan(peak)
    walker, swimmer = (np.bincount(cell, these) > 0 for these in (walker, swimmer))
    return np.asarray((walker & swimmer)[cell])


def lifts_cut_off(values: Floats) -> Bools:
    """Trials ``(n,)`` of values ``(n, 4)`` that swam, in a table whose lifts are cut off at 0; none in any other.

    A swimmer's lift scatters about the zero of the reading, as often below as above. Where none is negative and several
    are exactly 0, what was below was set to 0, or nothing was read: their mean says nothing about that zero.
    """
    lift = values[:, Observable.lift]
    above = lift[lift > 0]
    fine = 2 * len(np.unique(above)) > len(above)
    cut = bool(not (lift < 0).any() and (lift == 0).sum() >= LEAST_CUT_OFF and fine)
    return np.asarray(cut & np.isfinite(lift) & ~walks(values))


def _stance_rad(values: Floats, robot: Robot, accuracy: Accuracy) -> tuple[Floats, Floats]:
    """The least and the largest leg angle [rad] at which stance may have ended in trials of values ``(n, 4)``, given
    the usual scatter of their lift; NaN where lift was not measured, or nothing was lifted.
    """
    lift = np.where(walks(values), values[:, Observable.lift], np.nan)
    least, largest = (
        stance_angle(step_from_lift(np.maximum(lift + error, 0.0), robot.leg_radius_m), robot.leg_radius_m)
        for error in (-accuracy.lift_sd_m, accuracy.lift_sd_m)
    )
    return least, largest
