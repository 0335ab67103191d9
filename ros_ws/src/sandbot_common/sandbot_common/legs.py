"""Legs: how they are mounted on their shafts (robot.yaml, copied to /trial), and how fast they may turn."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_common.typed import number_or_nan

FASTEST_RAD_S = 1000.0
"""Several times the leg rate in the swing of the fastest gait; beyond it the state of the ground is meaningless."""


def leg_mount_rad(said: Mapping[str, object], where: str) -> float:
    """The offset from shaft angles to those of the c-legs' centres [rad]; 0 if not given.

    Raises InputError, naming ``where``, if it is not an angle.
    """
    value = said.get("leg_mount_rad", 0.0)
    angle = number_or_nan(value) if isinstance(value, int | float) else math.nan
    if not math.isfinite(angle):
        raise InputError(f"{where}: leg_mount_rad: {value!r} is not an angle [rad]")
    return angle


def check_turning(t_s: NDArray[np.float64], angles: NDArray[np.float64], rates: NDArray[np.float64]) -> None:
    """Raise InputError if a leg would turn impossibly fast: times (n,), angles (n, legs), rates of any shape.

    NaN angles, as before the first set-point, are ignored.
    """
    turning = np.diff(angles, axis=0) / np.diff(t_s)[:, None]
    fastest = np.fmax.reduce(np.abs(np.concatenate([rates.ravel(), turning.ravel()])))
    if fastest > FASTEST_RAD_S:
        raise InputError(f"set-points: a leg would turn at {fastest:.3g} rad/s, at most {FASTEST_RAD_S:g} is believed")
