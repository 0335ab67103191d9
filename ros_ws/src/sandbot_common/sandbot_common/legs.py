"""Legs: how they are mounted on their shafts (robot.yaml, copied to /trial), and what set-points they can follow."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_common.typed import number_or_nan

FASTEST_RAD_S = 1000.0
"""Several times the leg rate in the swing of the fastest gait; beyond it the state of the ground is meaningless."""
FARTHEST_RAD = 1e6
"""Of a day's walk; from there on an angle is resolved ever more coarsely, at 1e16 rad to no more than a turn."""

Angles = NDArray[np.float64]


def leg_mount_rad(said: Mapping[str, object], where: str) -> float:
    """The offset from shaft angles to those of the c-legs' centres [rad]; 0 if not given.

    Raises InputError, naming ``where``, if it is not an angle.
    """
    value = said.get("leg_mount_rad", 0.0)
    angle = number_or_nan(value) if isinstance(value, int | float) else math.nan
    if not math.isfinite(angle):
        raise InputError(f"{where}: leg_mount_rad: {value!r} is not an angle [rad]")
    return angle


def at_rest(rates: Sequence[float]) -> bool:
    """Whether joint states with these rates say that no leg turns; NaN, or no rates at all, does not say so."""
    return len(rates) > 0 and all(rate == 0 for rate in rates)


def by_leg(message: Any, order: Sequence[str]) -> tuple[Angles, Angles]:
    """Angles and rates (legs,) of a set-point, in this order, by name.

    Raises InputError if a leg is missing, if there is not one angle and one rate for each name, or if no leg can follow
    them.
    """
    counts = len(message.name), len(message.position), len(message.velocity)
    if len(set(counts)) != 1:
        raise InputError("set-points: {} names, {} angles, {} rates".format(*counts))
    place = {name: index for index, name in enumerate(message.name)}
    if missing := [name for name in order if name not in place]:
        raise InputError(f"set-points: no leg {missing[0]!r} among {', '.join(message.name) or 'no names'}")
    at = [place[name] for name in order]
    angles, rates = (np.asarray(values, np.float64)[at] for values in (message.position, message.velocity))
    check_legs(angles, rates)
    return angles, rates


def check_legs(angles: Angles, rates: Angles) -> None:
    """Raise InputError if no leg can be at such an angle, or turn at such a rate."""
    if not (np.isfinite(angles).all() and np.isfinite(rates).all()):
        raise InputError("set-points: an angle or rate is not finite")
    if (farthest := np.abs(angles).max(initial=0.0)) > FARTHEST_RAD:
        raise InputError(f"set-points: an angle of {farthest:.3g} rad, at most {FARTHEST_RAD:g} is believed")
    _check_rates(rates)


def check_turning(t_s: Angles, angles: Angles, rates: Angles) -> None:
    """Raise InputError if a leg would turn impossibly fast: times (n,), angles (n, legs), rates of any shape.

    NaN angles, as before the first set-point, are ignored.
    """
    turning = np.diff(angles, axis=0) / np.diff(t_s)[:, None]
    _check_rates(np.concatenate([rates.ravel(), turning.ravel()]))


def _check_rates(rates: Angles) -> None:
    fastest = np.fmax.reduce(np.abs(rates.ravel()))
    if fastest > FASTEST_RAD_S:
        raise InputError(f"set-points: a leg would turn at {fastest:.3g} rad/s, at most {FASTEST_RAD_S:g} is believed")
