"""The known state of legs and air: pure. Fed with every message and its arrival time [s, one clock].

Legs must never move while air is on. A state that was reported too long ago is unknown, and shown as such; but a robot
at rest and a clock that commands nothing may be silent. An overlap of air and motion is kept until it is acknowledged.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from sandbot_common.legs import at_rest

FRESH_S = 0.5
"""Moving legs and a bed report many times within this; an older report does not count."""
ALIVE_S = 1.5
"""The clock reports its health five times a second."""


@dataclass(frozen=True)
class Statement:
    """``state``, and one line that describes it to a person."""

    state: str
    text: str


@dataclass
class Overlap:
    """Air on while legs moved: from when to when [s]."""

    since_s: float
    until_s: float


@dataclass
class _Report:
    """The last reported value, and when it arrived."""

    value: float = math.nan
    heard_s: float = -math.inf

    def age_s(self, now_s: float) -> float:
        return now_s - self.heard_s


@dataclass
class Safety:
    """``overlap`` is kept until ``acknowledge``; ``rest_s`` and ``off_s``: when legs came to rest and air went off."""

    overlap: Overlap | None = None
    rest_s: float = -math.inf
    off_s: float = -math.inf
    _legs: _Report = field(default_factory=_Report)
    _air: _Report = field(default_factory=_Report)
    _clock: _Report = field(default_factory=_Report)

    def on_legs(self, rates_rad_s: Sequence[float], now_s: float) -> None:
        """A message of /leg_states. What does not say rest counts as turning."""
        moving = not at_rest(rates_rad_s)
        if not moving and self._legs.value != 0:
            self.rest_s = now_s
        self._legs = _Report(float(moving), now_s)
        self._check_overlap(now_s)

    def on_air(self, level: float, now_s: float) -> None:
        """A message of /bed/blower. NaN counts as on."""
        if level <= 0 and not self._air.value <= 0:
            self.off_s = now_s
        self._air = _Report(level, now_s)
        self._check_overlap(now_s)

    def on_clock(self, running: bool, now_s: float) -> None:
        """Whether the clock reports that it commands motion."""
        self._clock = _Report(float(running), now_s)

    def _check_overlap(self, now_s: float) -> None:
        if not (self.air(now_s).state == "on" and self.legs(now_s).state == "moving"):
            return
        if self.overlap is None:
            self.overlap = Overlap(now_s, now_s)
        self.overlap.until_s = now_s

    def acknowledge(self) -> None:
        """A person has seen the overlap."""
        self.overlap = None

    def legs(self, now_s: float) -> Statement:
        """moving, still or unknown."""
        report, clock = self._legs, self._clock
        if report.age_s(now_s) <= FRESH_S:
            return Statement("moving", "legs move") if report.value else Statement("still", "legs still")
        heard = math.isfinite(report.heard_s)
        if report.value:  # NaN too: never heard
            before = f"legs moved when last heard, {_ago(report, now_s)}" if heard else "nothing heard of the legs yet"
        else:
            before = f"legs last heard {_ago(report, now_s)}"
        if clock.age_s(now_s) > ALIVE_S:
            return Statement("unknown", f"{before}; the clock is silent")
        if clock.value:
            return Statement("unknown", f"{before}; the clock is running")
        if heard and report.value:
            return Statement("unknown", before)
        return Statement("still", "legs still" if heard else "legs not commanded, nothing heard of them yet")

    def air(self, now_s: float) -> Statement:
        """on, off or unknown."""
        report = self._air
        if report.age_s(now_s) > FRESH_S:
            if not math.isfinite(report.heard_s):
                return Statement("unknown", "nothing heard of the blower yet")
            return Statement("unknown", f"blower last heard {_ago(report, now_s)}, at {report.value:.2f}")
        return Statement("off", "air off") if report.value <= 0 else Statement("on", f"air on ({report.value:.2f})")

    def at_rest(self, now_s: float) -> bool:
        """Whether legs are known to be still and air to be off."""
        return self.legs(now_s).state == "still" and self.air(now_s).state == "off"

    def statement(self, now_s: float) -> Statement:
        """broken, overlapped, unknown, air, legs or free; the worst that applies."""
        legs, air = self.legs(now_s), self.air(now_s)
        if air.state == "on" and legs.state == "moving":
            return Statement("broken", "AIR IS ON WHILE LEGS MOVE: STOP")
        if (overlap := self.overlap) is not None:
            lasted = f"for {overlap.until_s - overlap.since_s:.2f} s, {now_s - overlap.until_s:.0f} s ago"
            return Statement("overlapped", f"AIR WAS ON WHILE LEGS MOVED, {lasted}; now: {air.text}, {legs.text}")
        if "unknown" in (legs.state, air.state):
            return Statement("unknown", f"not known: {air.text}; {legs.text}")
        if air.state == "on":
            return Statement("air", f"{air.text}: legs are locked")
        if legs.state == "moving":
            return Statement("legs", "legs move: air is locked")
        return Statement("free", f"{air.text}, {legs.text}")


def _ago(report: _Report, now_s: float) -> str:
    return f"{report.age_s(now_s):.0f} s ago"
