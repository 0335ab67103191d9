"""Simulated controllers, as simple as a microcontroller's program: lines in, lines out, and their own watchdog.

The clock is passed in (seconds); nothing here does input or output.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sandbot_common.errors import InputError
from sandbot_common.lease import Lease
from sandbot_common.legs import check_turning
from sandbot_hardware import lines
from sandbot_hardware.device_clock import DeviceClock
from sandbot_hardware.lines import Line

RESOLUTION_S = 1e-6
"""The line's time resolution: reports are at least so far apart."""
REPORT_S = 0.02
"""How often a device at rest reports unasked."""
Walk = Callable[[float, Sequence[float], Sequence[float]], tuple[Sequence[float], Sequence[float], Sequence[float]]]
"""From device time [s], commanded angles and rates to resulting angles, rates and efforts."""


class LegController:
    """Follows set-points. When the last one is older than its lease, the legs stop, and set-points that move them are
    ignored until one at rest arrives.

    It starts in that state, as it has not seen the start of a motion that was already under way.

    A set-point says where the legs are to be at its own time. It is skipped if it comes too late: if the state at that
    time has been reported already, or so shortly before that no leg could get there.
    """

    def __init__(self, legs: int, walk: Walk, begin: Callable[[float], None], lease_s: float = 0.24) -> None:
        """``begin`` is called with the device time at which the legs start from rest: the LED goes on."""
        self._legs, self._walk, self._begin = legs, walk, begin
        self._lease, self._host = Lease(lease_s), DeviceClock()
        self._held: Sequence[float] = [0.0] * legs
        self.moving, self.lapsed = False, True
        self._walking = False
        self.said_s = 0.0
        self._said: Sequence[float] = self._held

    def heard(self, line: Line, now_s: float) -> list[bytes]:
        """Its replies to a line."""
        if line.kind != "S" or len(line.values) != 1 + 2 * self._legs:
            return []
        replies = self._watch(now_s)
        # The set-point holds for its own time, however long its transmission took.
        t_s = self._host.host_ns(int(line.values[0]) * 1000, round(now_s * 1e9)) * 1e-9
        angles, rates = lines.split(line.values[1:], self._legs)
        moving = any(rates)
        if self.lapsed and moving:
            return replies
        self.lapsed = False
        self._lease.renew(now_s)
        self.moving, self._held = moving, angles
        self._walking = self._walking and moving
        if not self._in_time(t_s, angles, rates):
            return replies
        if moving and not self._walking:
            self._walking = True
            self._begin(t_s)
            replies.append(lines.encode("E", _us(t_s)))
        return [*replies, self._report(t_s, angles, rates)]

    def tick(self, now_s: float) -> list[bytes]:
        """What it sends unasked: leg positions, and that its watchdog has stopped the legs."""
        if sent := self._watch(now_s):
            return sent
        if not self.moving and now_s - self.said_s >= REPORT_S:
            return [self._report(now_s, self._held, [0.0] * self._legs)]
        return []

    @property
    def obeyed_s(self) -> float:
        """Device time of the last set-point it obeyed."""
        return self._lease.renewed_s

    def _watch(self, now_s: float) -> list[bytes]:
        if not (self.moving and self._lease.late(now_s)):
            return []
        self.moving, self.lapsed, self._walking = False, True, False
        return [self._report(now_s, self._held, [0.0] * self._legs), lines.encode("W", lines.LEGS_AT_REST)]

    def _in_time(self, t_s: float, angles: Sequence[float], rates: Sequence[float]) -> bool:
        """Whether the legs can get there from where they were last reported."""
        if t_s < self.said_s + RESOLUTION_S:
            return False
        try:
            check_turning(np.array([self.said_s, t_s]), np.array([self._said, angles]), np.array(rates))
        except InputError:
            return False
        return True

    def _report(self, now_s: float, angles: Sequence[float], rates: Sequence[float]) -> bytes:
        self.said_s, self._said = now_s, angles
        walked = [float(value) for values in self._walk(now_s, angles, rates) for value in values]
        return lines.encode("L", _us(now_s), *walked)


class BedController:
    """A blower and a height sensor; air off when the last level is older than its lease."""

    def __init__(
        self, blow: Callable[[float, float], None], height_m: Callable[[float], float], lease_s: float = 0.45
    ) -> None:
        """``blow(level, now_s)`` and ``height_m(now_s)`` connect to the bed."""
        self._blow, self._height_m, self._lease = blow, height_m, Lease(lease_s)
        self.level = self.said_s = 0.0

    def heard(self, line: Line, now_s: float) -> list[bytes]:
        """Its replies to a line."""
        if line.kind == "B" and len(line.values) == 1 and 0.0 <= line.values[0] <= 1.0:
            self._lease.renew(now_s)
            self._set(line.values[0], now_s)
        return []

    def tick(self, now_s: float) -> list[bytes]:
        """What it sends unasked."""
        sent = []
        if self.level > 0.0 and self._lease.late(now_s):
            self._set(0.0, now_s)
            sent.append(lines.encode("W", lines.AIR_OFF))
        if now_s - self.said_s >= REPORT_S:
            self.said_s = now_s
            sent.append(lines.encode("H", self._height_m(now_s)))
        return sent

    @property
    def obeyed_s(self) -> float:
        """Device time of the last level it obeyed."""
        return self._lease.renewed_s

    def _set(self, level: float, now_s: float) -> None:
        if level != self.level:
            self.level = level
            self._blow(level, now_s)


def _us(now_s: float) -> int:
    return round(now_s * 1e6)
