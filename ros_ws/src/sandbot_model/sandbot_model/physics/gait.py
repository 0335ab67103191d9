"""Gaits: how fast a leg turns in each phase of the clock signal (physics §1; Li09)."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from sandbot_common.arrays import Bools, Floats

GAITS = {"SGCS": (1.1, -0.5, 0.45), "HGCS": (0.85, 0.13, 0.56), "UNIFORM": (np.pi, 0.0, 0.5)}
"""θ_s, θ_0 [rad] and d_c of the clock signal. The name of a custom one contains them: CUSTOM(θ_s θ_0 d_c)."""
ASSUMED = "SGCS"
"""The gait assumed for trials whose table does not give one."""
STANCE_END = 0.75
"""Leg angle [rad] at which a long stance ends, asin(s/2R)."""
USUAL_FRAME_RATE_HZ = 100.0
"""Frames per second where the data do not give them (Li09)."""
SEEN_RAD = 0.1
"""Angle through which a leg must turn at the swing rate before v_x(t) shows all of it."""
FRAMES_OF_A_PEAK = 2.5
"""Frames that the fast part of a stance must last for its peak to be seen."""
_CUSTOM = re.compile(r"CUSTOM\((\S+) (\S+) (\S+)\)")


def clock_signal(gait: str) -> tuple[float, float, float] | None:
    """θ_s, θ_0 [rad] and d_c of a gait by its name; None where the name does not determine them."""
    custom = _CUSTOM.fullmatch(gait)
    if custom is None:
        return GAITS.get(gait)
    try:
        theta_s, theta_0, duty = map(float, custom.groups())
    except ValueError:
        return None
    possible = 0 < theta_s < 2 * np.pi and abs(theta_0) <= np.pi and 0 < duty < 1
    return (theta_s, theta_0, duty) if possible else None


def assumption(gaits: Iterable[str]) -> str:
    """In words, what is assumed of gaits whose name does not determine the clock signal; empty if of none."""
    unknown = sorted({repr(gait) if gait else "not given" for gait in gaits if clock_signal(gait) is None})
    return f"gait {', '.join(unknown)}: the clock signal of {ASSUMED} is assumed" if unknown else ""


@dataclass(frozen=True, eq=False)
class Clock:
    """How legs turn; arrays of one shape."""

    slow_ratio: Floats
    """β = θ_s/(2π d_c): leg rate in the slow phase over the mean rate."""
    swing_ratio: Floats
    """(2π - θ_s)/(2π(1 - d_c)), that of the fast phase."""
    slow_begin_rad: Floats
    """θ_0 - θ_s/2, the shaft angle at which the slow phase begins."""
    slow_end_rad: Floats
    """θ_0 + θ_s/2, the one at which it ends."""

    @property
    def one_rate(self) -> Bools:
        """Whether legs turn at a constant rate, without phases."""
        return np.asarray(self.slow_ratio == self.swing_ratio)

    def __getitem__(self, index: Any) -> "Clock":
        """Some of the elements, indexed as an array is."""
        return Clock(*(values[index] for values in astuple(self)))


EVEN = Clock(np.ones(()), np.ones(()), np.full((), -np.pi / 2), np.full((), np.pi / 2))
"""Legs that turn at one rate."""


def clock(gaits: Sequence[str]) -> Clock:
    """How legs turn in gaits by their names, ``(n,)``; as in the ``ASSUMED`` gait where a name is unknown."""
    theta_s, theta_0, duty = np.array([clock_signal(gait) or GAITS[ASSUMED] for gait in gaits]).T
    turn = 2 * np.pi
    slow, swing = theta_s / (turn * duty), (turn - theta_s) / (turn * (1 - duty))
    return Clock(slow, swing, theta_0 - theta_s / 2, theta_0 + theta_s / 2)


def duty(slow_ratio: Floats, swing_ratio: Floats) -> Floats:
    """d_c, the slow phase's fraction of a period, from d_c β + (1 - d_c) β_swing = 1; 1 where legs turn at one rate."""
    one_rate = slow_ratio == swing_ratio
    share: Floats = np.where(one_rate, 1.0, (swing_ratio - 1) / np.where(one_rate, 1.0, swing_ratio - slow_ratio))
    return share


def first_step_rad(slow_ratio: Floats, swing_ratio: Floats, slow_from_rad: Floats) -> Floats:
    """How long a first step lasts, ωt [rad]: until the mean angle of both tripods is a multiple of π.

    One tripod starts at the beginning of its slow phase, ``slow_from_rad`` before its lowest point, the other is half
    a period behind. Their mean turns by π in half a period; to a multiple of π it has slightly more or less to go.
    """
    slow_share = duty(slow_ratio, swing_ratio)
    fast_half = np.minimum(2 * np.pi * (1 - slow_share), np.pi)
    begins_at = -(slow_from_rad + (fast_half * swing_ratio + (np.pi - fast_half) * slow_ratio) / 2)
    to_go = np.pi * np.floor(begins_at / np.pi + 0.5) - begins_at
    # Mean rate of the two right after and right before half a period; ``long``: the slow phase is the longer one.
    one_each = (slow_ratio + swing_ratio) / 2
    long = slow_share >= 0.5
    late, early = np.where(long, slow_ratio, one_each), np.where(long, one_each, swing_ratio)
    lasts: Floats = np.pi + to_go / np.where(to_go > 0, late, early)
    return lasts


def slow_phase_ratio(gait: str) -> float:
    """β of a gait by its name."""
    return float(clock([gait]).slow_ratio[0])


def fastest_phase_ratio(gait: str) -> float:
    """Largest leg rate of a cycle over the mean rate, in whichever phase it is."""
    turns = clock([gait])
    return float(max(turns.slow_ratio[0], turns.swing_ratio[0]))


def peaks_resolved(
    turns: Clock, omega: Floats, stance_rad: tuple[Floats, Floats], mount_rad: float, rate_hz: float
) -> Bools:
    """Whether the cameras resolve the fastest part of a stance ``(n,)``, at ``rate_hz`` frames per second.

    A stance that outlasts the slow phase has its peak speed in the fast one, which must last long enough to be seen:
    within two frames the largest v_x(t) depends on the cameras and not on the robot. A stance within the slow phase has
    no such part. ``stance_rad`` are the least and the greatest stance angle compatible with the lift measured; a peak
    that may belong to either phase is not used. NaN: the usual stance is assumed.
    """
    slow_rad = np.minimum(-(turns.slow_begin_rad + mount_rad), turns.slow_end_rad + mount_rad)
    least, largest = (np.where(np.isfinite(angle), angle, STANCE_END) for angle in stance_rad)
    lasts_s = (STANCE_END - slow_rad) / (turns.swing_ratio * omega)
    seen = (slow_rad >= STANCE_END) | (lasts_s >= FRAMES_OF_A_PEAK / rate_hz)
    return np.asarray((largest < slow_rad) | ((least > slow_rad + SEEN_RAD) & seen))
