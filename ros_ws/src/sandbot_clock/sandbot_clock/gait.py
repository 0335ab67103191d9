"""The gait: the angle of each leg at each time (Li09, clock signal).

One turn of a leg has a slow phase (stance), the span θ_s about θ_0 during the fraction d_c of the period, and a fast
phase (swing), the remaining 2π − θ_s. A *phase* is counted in turns and never wrapped: 0 is the start of the
first slow phase. Angles are leg angles θ [rad], growing with time; θ = 0 has the leg straight below the axle.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.parameters import check as check_parameter
from sandbot_common.parameters import parameter, specs
from sandbot_common.robot import SANDBOT

TURN = 2 * math.pi
TRIPOD = SANDBOT.legs_per_tripod
"""Legs in a tripod; in every array of legs, tripod A's come first, then tripod B's."""
TRIPOD_B_LAG = 0.5
"""Tripod B runs this many turns behind tripod A."""


@dataclass(frozen=True)
class Gait:
    """The shape of the clock signal. Raises InputError if a value is out of bounds."""

    theta_s_rad: float = parameter(unit="rad", doc="span θ_s of the slow phase", low=0.05, high=6.2)
    theta_0_rad: float = parameter(unit="rad", doc="middle θ_0 of the slow phase", low=-math.pi, high=math.pi)
    duty: float = parameter(doc="fraction d_c of the period spent in the slow phase", low=0.05, high=0.95)

    def __post_init__(self) -> None:
        for spec in specs(Gait):
            check_parameter(spec, getattr(self, spec.name), "gait")

    @classmethod
    def from_name(cls, name: str) -> "Gait":
        """A preset by its name. Raises InputError for an unknown name."""
        if name not in PRESETS:
            raise InputError(f"gait: {name!r} is not one of {', '.join(PRESETS)}")
        return PRESETS[name]

    @property
    def start_rad(self) -> float:
        """The leg angle at the start of the slow phase, θ_0 − θ_s/2."""
        return self.theta_0_rad - self.theta_s_rad / 2

    @property
    def slow_phase_ratio(self) -> float:
        """β = θ_s / (2π d_c): leg rate in the slow phase over the mean rate ω."""
        return self.theta_s_rad / (TURN * self.duty)

    @property
    def fast_phase_ratio(self) -> float:
        """(2π − θ_s) / (2π (1 − d_c)): leg rate in the fast phase over the mean rate ω."""
        return (TURN - self.theta_s_rad) / (TURN * (1 - self.duty))


PRESETS = {
    "SGCS": Gait(1.1, -0.5, 0.45),
    "HGCS": Gait(0.85, 0.13, 0.56),
    "UNIFORM": Gait(math.pi, 0.0, 0.5),
}
"""Soft ground and hard ground clock signal of Li09; UNIFORM, ours, turns at the constant rate ω."""


def angle_of_phase(gait: Gait, phase: ArrayLike) -> tuple[Floats, Floats]:
    """The angle [rad] and its slope [rad/turn] at a phase [turns]; both of the phase's shape.

    Where two phases meet, the slope is that of the one that begins.
    """
    turns = np.asarray(phase, dtype=np.float64)
    whole = np.floor(turns)
    part = turns - whole
    slow, fast = TURN * gait.slow_phase_ratio, TURN * gait.fast_phase_ratio
    in_slow = part < gait.duty
    within = np.where(in_slow, slow * part, gait.theta_s_rad + fast * (part - gait.duty))
    return gait.start_rad + TURN * whole + within, np.where(in_slow, slow, fast)


def phase_of_angle(gait: Gait, angle_rad: ArrayLike) -> Floats:
    """The phase [turns] at which the leg stands at an angle [rad]; the inverse of ``angle_of_phase``."""
    turned = (np.asarray(angle_rad, dtype=np.float64) - gait.start_rad) / TURN
    whole = np.floor(turned)
    within = TURN * (turned - whole)
    slow = within / (TURN * gait.slow_phase_ratio)
    fast = gait.duty + (within - gait.theta_s_rad) / (TURN * gait.fast_phase_ratio)
    return np.asarray(whole + np.where(within < gait.theta_s_rad, slow, fast), dtype=np.float64)


def leg_angles(gait: Gait, omega_rad_s: float, t_s: ArrayLike, tripod: int = TRIPOD) -> tuple[Floats, Floats]:
    """Leg angles [rad] and rates [rad/s], each ``(*t_s.shape, 2 tripod)`` in the order of ``Robot.leg_order``.

    At t = 0 tripod A starts its slow phase and tripod B is half a turn of phase behind. Angles grow without wrapping.
    Raises InputError if ω is negative or not finite.
    """
    turns_per_s = check_omega(omega_rad_s) / TURN
    phase_a = turns_per_s * np.asarray(t_s, dtype=np.float64)
    return tripod_angles(gait, phase_a, phase_a - TRIPOD_B_LAG, turns_per_s, turns_per_s, tripod)


def tripod_angles(
    gait: Gait, phase_a: Floats, phase_b: Floats, pace_a: ArrayLike, pace_b: ArrayLike, tripod: int
) -> tuple[Floats, Floats]:
    """Angles [rad] and rates [rad/s] ``(*phase_a.shape, 2 tripod)`` of all legs from two tripods' phases [turns] and
    paces [turns/s]."""
    angle, slope = angle_of_phase(gait, np.stack([phase_a, phase_b], axis=-1))
    pace = np.stack(np.broadcast_arrays(pace_a, pace_b, phase_a)[:2], axis=-1)
    return np.repeat(angle, tripod, axis=-1), np.repeat(slope * pace, tripod, axis=-1)


def check_omega(omega_rad_s: float) -> float:
    """ω unchanged. Raises InputError if it is negative or not finite."""
    if not (math.isfinite(omega_rad_s) and omega_rad_s >= 0):
        raise InputError(f"omega_rad_s: {omega_rad_s} is not a finite number >= 0 rad/s")
    return omega_rad_s
