"""Legs: where they sit on their shafts (as robot.yaml says and /trial passes on), and how fast they may turn."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError

FASTEST_RAD_S = 1000.0
"""Several times what legs turn at in the swing of the fastest gait; beyond it the ground's state means nothing."""


def leg_mount_rad(said: Mapping[str, object], where: str) -> float:
    """What must be added to shaft angles to give those of the c-legs' centres [rad]; 0 where nothing is said of it.

    Raises InputError, naming ``where``, if it is no angle.
    """
    value = said.get("leg_mount_rad", 0.0)
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{where}: leg_mount_rad: {value!r} is not an angle [rad]")
    return float(value)


def check_turning(t_s: NDArray[np.float64], angles: NDArray[np.float64], rates: NDArray[np.float64]) -> None:
    """Raise InputError where a leg would turn as fast as none does: times (n,), angles (n, legs), rates of any shape.

    Angles that are NaN tell nothing of how fast: before the first set-point, say.
    """
    turning = np.diff(angles, axis=0) / np.diff(t_s)[:, None]
    fastest = np.fmax.reduce(np.abs(np.concatenate([rates.ravel(), turning.ravel()])))
    if fastest > FASTEST_RAD_S:
        raise InputError(f"set-points: a leg would turn at {fastest:.3g} rad/s, at most {FASTEST_RAD_S:g} is believed")
