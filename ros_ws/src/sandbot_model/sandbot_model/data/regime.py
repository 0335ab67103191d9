"""Whether a robot walked or swam, from what was measured of it."""

from collections.abc import Iterable

import numpy as np

from sandbot_common.accuracy import Accuracy
from sandbot_common.robot import Robot
from sandbot_model.physics.arrays import Array, Bool
from sandbot_model.physics.gait import clock, duty, peaks_resolved, slow_phase_ratio
from sandbot_model.physics.geometry import stance_angle, step_from_lift
from sandbot_model.physics.observables import Observable

WALKING_LIFT_M = 3e-4
"""Lift above which a body was lifted by its legs: several times what the tracking makes of none."""
SURE_LIFT_M = 4 * WALKING_LIFT_M
"""Lift that is more than a zero that is off by a grain."""
WALKING_SPEED_M_S = 0.035
"""Clearly faster than swimming (Li09: 0.02 m/s)."""
HELD_M = 0.01
"""What a first step is longer at least than a swimmer's if the leg held in it."""


def walks(values: Array, least_lift_m: Array | float = WALKING_LIFT_M) -> Bool:
    """Whether the robot walked ``(...)``, of measured observables ``(..., 4)``: its body was lifted by more than
    ``least_lift_m``, or, where lift was not measured, it was faster than any swimmer. A body that never was that fast
    was lifted only if it was by more than a zero may be off.
    """
    speed, lift, peak = (values[..., one] for one in (Observable.speed, Observable.lift, Observable.peak_speed))
    lifted = (lift > least_lift_m) & ~((peak <= WALKING_SPEED_M_S) & (lift <= SURE_LIFT_M))
    return np.where(np.isfinite(lift), lifted, speed > WALKING_SPEED_M_S)


def swum_at_once(gaits: Iterable[str], omega: Array, values: Array) -> Bool:
    """Trials ``(n,)`` of values ``(n, 4)`` that swam from the first step on, with legs of uneven pace.

    How far they get in it is the clock's affair: where on its shaft the leg is mounted says when it passes its lowest
    point, and the table does not say that. A trial that swims after a first step that held is none of them.
    """
    uneven = np.array([slow_phase_ratio(gait) != 1.0 for gait in gaits])
    speed, first_step = values[:, Observable.speed], values[:, Observable.first_step]
    return np.asarray(uneven & ~walks(values) & (first_step < speed * np.pi / omega + HELD_M))


def begins_on_both(gaits: Iterable[str]) -> Bool:
    """Trials ``(n,)`` of gaits whose slow phase lasts more than half a period: their first step is no single leg's.

    The other tripod is in its slow phase as the robot sets out, and takes hold again before the step is over.
    """
    turning = clock([*gaits])
    return np.asarray(~turning.one_rate & (duty(turning.slow_ratio, turning.swing_ratio) > 0.5))


def peaks_seen(
    gaits: Iterable[str], omega: Array, values: Array, robot: Robot, accuracy: Accuracy, rate_hz: float
) -> Bool:
    """Trials ``(n,)`` of values ``(n, 4)`` whose peak the cameras saw, and of whose phase the lift leaves no doubt."""
    return peaks_resolved(clock([*gaits]), omega, _stance_rad(values, robot, accuracy), robot.leg_mount_rad, rate_hz)


def _stance_rad(values: Array, robot: Robot, accuracy: Accuracy) -> tuple[Array, Array]:
    """The least and the largest leg angle [rad] in which trials of values ``(n, 4)`` may have ended their stance, by a
    lift that is uncertain by its usual scatter; NaN where lift was not measured, or nothing was lifted.
    """
    lift = np.where(walks(values), values[:, Observable.lift], np.nan)
    least, largest = (
        stance_angle(step_from_lift(np.maximum(lift + error, 0.0), robot.leg_radius_m), robot.leg_radius_m)
        for error in (-accuracy.lift_sd_m, accuracy.lift_sd_m)
    )
    return least, largest
