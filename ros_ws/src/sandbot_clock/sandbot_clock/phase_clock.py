"""A running gait whose ω and shape may change, which may start and stop, and in which no leg ever jumps.

Each change gives a new PhaseClock (it is frozen), anchored at the instant of the change: between changes the phase is
one multiplication from the anchor, so no error accumulates.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sandbot_clock.gait import (
    TRIPOD,
    TRIPOD_B_LAG,
    TURN,
    Gait,
    angle_of_phase,
    check_omega,
    phase_of_angle,
    tripod_angles,
)
from sandbot_common.arrays import Floats


@dataclass(frozen=True)
class PhaseClock:
    """The state of the clock at its anchor ``t0_s``; a new one stands still at home (tripod A starts its stance).

    A change of ω keeps the phase. A change of gait keeps both tripods' *angles*: the phase is solved anew for tripod
    A; for tripod B the new gait may put the same angle at another lag than half a turn. That excess ``lead_b``
    (always within ±1/2 turn, because B's angle lies between A's and A's less one turn) fades linearly to zero during
    A's next turn, in which B therefore turns at (1 − lead_b) times its pace: never backwards, never a jump.
    """

    gait: Gait
    omega_rad_s: float
    running: bool = False
    t0_s: float = 0.0
    phase_a: float = 0.0
    lead_b: float = 0.0
    tripod: int = TRIPOD
    """Legs of a tripod."""

    def __post_init__(self) -> None:
        check_omega(self.omega_rad_s)

    def at(self, t_s: ArrayLike) -> tuple[Floats, Floats]:
        """Leg angles [rad] and rates [rad/s] at times t_s >= t0_s, ``(*t_s.shape, 2 tripod)``; rates 0 when stopped."""
        phase_a, phase_b, pace_a, pace_b = self._phases(t_s)
        return tripod_angles(self.gait, phase_a, phase_b, pace_a, pace_b, self.tripod)

    def started(self, t_s: float) -> "PhaseClock":
        """Running from ``t_s`` on, from the angles it holds."""
        return replace(self._anchored(t_s), running=True)

    def stopped(self, t_s: float) -> "PhaseClock":
        """Holding the angles of ``t_s``, rates zero."""
        return replace(self._anchored(t_s), running=False)

    def with_omega(self, t_s: float, omega_rad_s: float) -> "PhaseClock":
        """At another ω from ``t_s`` on; the phase continues."""
        return replace(self._anchored(t_s), omega_rad_s=omega_rad_s)

    def with_gait(self, t_s: float, gait: Gait) -> "PhaseClock":
        """In another gait from ``t_s`` on; every leg's angle continues (see the class)."""
        phase_a, phase_b, _, _ = self._phases(t_s)
        angles, _ = angle_of_phase(self.gait, np.stack([phase_a, phase_b]))
        new_a, new_b = phase_of_angle(gait, angles)
        lead_b = float(new_b - (new_a - TRIPOD_B_LAG))
        return replace(self, gait=gait, t0_s=t_s, phase_a=float(new_a), lead_b=lead_b)

    def _phases(self, t_s: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
        # Phases [turns] and paces [turns/s] of the tripods.
        elapsed = np.asarray(t_s, dtype=np.float64) - self.t0_s
        pace = np.full_like(elapsed, self.omega_rad_s / TURN if self.running else 0.0)
        turned = pace * elapsed
        fading = np.clip(1 - turned, 0.0, 1.0)
        phase_a = self.phase_a + turned
        phase_b = phase_a - TRIPOD_B_LAG + self.lead_b * fading
        return phase_a, phase_b, pace, pace * np.where(turned < 1, 1 - self.lead_b, 1.0)

    def _anchored(self, t_s: float) -> "PhaseClock":
        phase_a, phase_b, _, _ = self._phases(t_s)
        lead_b = float(phase_b - (phase_a - TRIPOD_B_LAG))
        return replace(self, t0_s=t_s, phase_a=float(phase_a), lead_b=lead_b)
