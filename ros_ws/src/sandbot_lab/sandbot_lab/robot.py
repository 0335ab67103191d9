"""The virtual robot: leg set-points in, body motion out, step by step or a whole trial at once (the same kernel).

robot = LabRobot(world, phi, seed);  state = robot.advance(t_s, angles, rates)
trace = simulate(world, phi, t_s, angles, rates, seed)
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.legs import check_legs, check_turning
from sandbot_lab import kernel, resistive_kernel
from sandbot_lab.physics import fresh_state, physics_record
from sandbot_lab.week import Occasion, Week, seen_x_m
from sandbot_lab.world import START_X_M, World

PHI_LOW, PHI_HIGH = 0.5, 0.7


@dataclass(frozen=True)
class BodyState:
    """The robot at one moment; frame `trackway`, leg arrays of shape (legs,)."""

    t_s: float
    x_m: float
    z_m: float
    v_x_m_s: float
    pitch_rad: float
    leg_angle_rad: Floats
    leg_rate_rad_s: Floats
    leg_effort_n_m: Floats
    mode: int
    """0 at rest on the belly, 1 held by the ground, 2 swimming."""


@dataclass(frozen=True)
class Trace:
    """A whole trial: arrays (n,) over time, leg arrays (n, legs); frame `trackway`, z: axles above the surface."""

    t_s: Floats
    x_m: Floats
    z_m: Floats
    v_x_m_s: Floats
    pitch_rad: Floats
    leg_angle_rad: Floats
    leg_rate_rad_s: Floats
    leg_effort_n_m: Floats
    mode: NDArray[np.int8]
    """0 at rest on the belly, 1 held by the ground, 2 swimming."""
    tripod: NDArray[np.int8]
    """The tripod that is held (0 or 1), -1 if none."""


class LabRobot:
    """A robot at rest at ``start_x_m`` on virgin ground of volume fraction phi; all randomness comes from ``seed``."""

    def __init__(self, world: World, phi: float, seed: int, start_x_m: float = START_X_M) -> None:
        """Raises InputError for an impossible volume fraction."""
        self._run = _mechanism(world, checked_phi(phi), seed, start_x_m)
        self._legs = len(world.body.leg_order)
        self._rows = np.zeros((1, 5 + 3 * self._legs))
        self._t, self._angles = -np.inf, np.full(self._legs, np.nan)

    def advance(self, t_s: float, angles_rad: ArrayLike, rates_rad_s: ArrayLike) -> BodyState:
        """The body at ``t_s``, where the legs' set-points are ``angles`` and ``rates`` (legs,) [rad, rad/s].

        The first call sets the initial leg angles. Raises InputError if time runs backwards, a value isn't finite, or a
        leg would turn impossibly fast.
        """
        angles, rates = (np.ascontiguousarray(legs, np.float64) for legs in (angles_rad, rates_rad_s))
        times = np.array([self._t, t_s])
        _check_legs(times, angles[None], rates[None], self._legs)
        check_turning(times, np.stack([self._angles, angles]), rates)
        self._run(np.array([t_s], np.float64), angles[None], rates[None], self._rows)
        self._t, self._angles = float(t_s), angles.copy()
        row = self._rows[0]
        return BodyState(
            t_s=self._t,
            x_m=float(row[0]),
            z_m=float(row[1]),
            v_x_m_s=float(row[2]),
            pitch_rad=0.0,
            **_of_legs(row.copy()),
            mode=int(row[3]),
        )


def simulate(
    world: World,
    phi: float,
    t_s: ArrayLike,
    angles_rad: ArrayLike,
    rates_rad_s: ArrayLike,
    seed: int,
    start_x_m: float = START_X_M,
) -> Trace:
    """A whole trial from set-points t (n,), angles and rates (n, legs). Equal to `LabRobot.advance` row by row.

    Raises InputError on inconsistent shapes, time that does not increase, values that aren't finite.
    """
    times = np.ascontiguousarray(t_s, np.float64)
    angles, rates = np.ascontiguousarray(angles_rad, np.float64), np.ascontiguousarray(rates_rad_s, np.float64)
    legs = len(world.body.leg_order)
    if times.ndim != 1 or times.size == 0 or angles.shape != (times.size, legs):
        raise InputError(f"set-points: t_s {times.shape}, angles {angles.shape}: expected (n,) and (n, {legs})")
    _check_legs(times, angles, rates, legs)
    check_turning(times, angles, rates)
    rows: NDArray[Any] = np.zeros((times.size, 5 + 3 * legs))
    _mechanism(world, checked_phi(phi), seed, start_x_m)(times, angles, rates, rows)
    return Trace(
        t_s=times,
        x_m=rows[:, 0],
        z_m=rows[:, 1],
        v_x_m_s=rows[:, 2],
        pitch_rad=np.zeros(times.size),
        **_of_legs(rows),
        mode=rows[:, 3].astype(np.int8),
        tripod=rows[:, 4].astype(np.int8),
    )


def _mechanism(world: World, phi: float, seed: int, start_x_m: float) -> Callable[..., None]:
    """The `kernel.run` of this world's kind of ground, bound to a robot at rest."""
    if world.resistive:
        return partial(resistive_kernel.run, *resistive_kernel.records(world, world.resistive, phi, seed, start_x_m))
    return partial(kernel.run, physics_record(world, phi, seed), fresh_state(world, start_x_m))


def as_seen(trace: Trace, week: Week, occasion: Occasion) -> Trace:
    """The motion as seen by cameras with a scale error and a lift offset; the offset lowers the starting height."""
    z_m = trace.z_m.copy()
    z_m[0] -= week.lift_offset_m(occasion)
    x_m = seen_x_m(trace.x_m, float(trace.x_m[0]), week.scale_error(occasion))
    return replace(trace, x_m=x_m, z_m=z_m)


def checked_phi(phi: float) -> float:
    """The volume fraction, or InputError if grains can't have it."""
    if not PHI_LOW <= phi <= PHI_HIGH:
        raise InputError(f"phi: {phi} is outside [{PHI_LOW}, {PHI_HIGH}] (volume fraction of a bed of grains)")
    return float(phi)


def _of_legs(row: Floats) -> dict[str, Floats]:
    angle, rate, effort = np.split(row[..., 5:], 3, axis=-1)
    return {"leg_angle_rad": angle, "leg_rate_rad_s": rate, "leg_effort_n_m": effort}


def _check_legs(t_s: Floats, angles: Floats, rates: Floats, legs: int) -> None:
    if angles.shape != rates.shape or angles.shape[-1] != legs:
        raise InputError(f"set-points: angles {angles.shape}, rates {rates.shape}: expected {legs} legs in both")
    if not np.isfinite(t_s[-1]) or not (np.diff(t_s) > 0).all():
        raise InputError(f"set-points: time must be finite and rise, got {t_s[-1]} after {t_s[0]}")
    check_legs(angles, rates)
