"""What the console page shows, and nothing of how it is heard or served: latest values and short histories. Pure.

Times are seconds of one steady clock, passed in. The node feeds it; ``snapshot`` is what the page draws.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sandbot_common.errors import InputError
from sandbot_common.files import parse_json

HISTORY_S = 10.0
"""How far back the speed plot reaches."""

RATE_WINDOW_S = 2.0
SILENT_S = 2.0
"""A topic that was heard and then is not for this long is called silent."""

ACTIONS: Mapping[str, str] = {
    "prepare": "/bed/prepare",
    "abort": "/bed/abort",
    "start": "/clock/start",
    "stop": "/clock/stop",
}
"""What the page's buttons call: std_srvs/Trigger services."""


class Series:
    """The last ``HISTORY_S`` of one quantity against the time stamps of its messages [s]."""

    def __init__(self, history_s: float = HISTORY_S) -> None:
        self._history_s = history_s
        self._points: deque[tuple[float, float]] = deque()

    def add(self, t_s: float, value: float) -> None:
        """Append a point; a stamp before the last one (a new trial, a replay from the start) begins anew."""
        if self._points and t_s < self._points[-1][0]:
            self._points.clear()
        self._points.append((t_s, value))
        while t_s - self._points[0][0] > self._history_s:
            self._points.popleft()

    @property
    def latest_s(self) -> float:
        """The last time stamp, minus infinity where there is none."""
        return self._points[-1][0] if self._points else -math.inf

    def columns(self, zero_s: float) -> dict[str, list[float | None]]:
        """Times before ``zero_s`` [s, not positive] and values; not measured (NaN) is None, a gap in the plot."""
        return {
            "t_s": [round(t_s - zero_s, 4) for t_s, _ in self._points],
            "value": [value if math.isfinite(value) else None for _, value in self._points],
        }


class Arrivals:
    """When the messages of one topic came: their rate and how long ago the last one was."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()
        self._first_s = math.inf

    def add(self, now_s: float) -> None:
        """A message came."""
        self._first_s = min(self._first_s, now_s)
        self._times.append(now_s)
        self._forget(now_s)

    def health(self, now_s: float, latched: bool) -> dict[str, Any]:
        """``state`` (waiting, ok, silent; held for a latched one that has come), ``rate_hz`` and ``age_s``."""
        if not math.isfinite(self._first_s):
            return {"state": "waiting", "rate_hz": 0.0, "age_s": None}
        self._forget(now_s)
        age_s = now_s - self._times[-1]
        heard = max(min(RATE_WINDOW_S, now_s - self._first_s), 0.5)
        recent = sum(1 for t_s in self._times if now_s - t_s <= RATE_WINDOW_S)
        state = "held" if latched else "ok" if age_s <= SILENT_S else "silent"
        return {"state": state, "rate_hz": round(recent / heard, 1), "age_s": round(age_s, 1)}

    def _forget(self, now_s: float) -> None:
        # The last one stays, however old: its age is what is asked for.
        while len(self._times) > 1 and now_s - self._times[0] > RATE_WINDOW_S:
            self._times.popleft()


@dataclass
class Console:
    """The state behind the page. Every method is cheap; the node calls them as messages come."""

    latched: Mapping[str, bool]
    arrivals: dict[str, Arrivals] = field(init=False)
    measured: Series = field(default_factory=Series)
    predicted: Series = field(default_factory=Series)
    values: dict[str, float] = field(default_factory=dict)
    bed: dict[str, str] = field(default_factory=dict)
    trial: dict[str, Any] = field(default_factory=dict)
    legs_moving: bool | None = None
    pictures: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.arrivals = {name: Arrivals() for name in self.latched}

    def heard(self, topic: str, now_s: float) -> None:
        """Count a message of ``topic``."""
        self.arrivals[topic].add(now_s)

    def set_trial(self, text: str) -> None:
        """What /trial says (JSON); other text is shown as it is."""
        try:
            content = parse_json(text, "/trial")
        except InputError:
            content = None
        self.trial = content if isinstance(content, dict) else {"trial_id": text}

    def set_legs(self, rates_rad_s: Iterable[float]) -> None:
        """Whether any leg turns; NaN counts as turning."""
        self.legs_moving = any(rate != 0 for rate in rates_rad_s)

    def new_picture(self, camera: str) -> None:
        """A newer picture of ``camera`` is there."""
        self.pictures[camera] = self.pictures.get(camera, 0) + 1

    @property
    def interlock(self) -> dict[str, str]:
        """Legs never move while air is on: who is locked now, and by what."""
        blower = self.values.get("blower")
        # "not <= 0" so that NaN counts as on.
        air_on = blower is not None and not blower <= 0
        if air_on and self.legs_moving:
            return {"state": "broken", "text": "AIR IS ON WHILE LEGS MOVE: abort"}
        if air_on:
            return {"state": "air", "text": f"air is on ({blower:.2f}): legs are locked"}
        if self.legs_moving:
            return {"state": "legs", "text": "legs move: air is locked"}
        if blower is None or self.legs_moving is None:
            unheard = "the blower" if blower is None else "the legs"
            return {"state": "unknown", "text": f"nothing heard of {unheard} yet"}
        return {"state": "free", "text": "air off, legs still"}

    def snapshot(self, now_s: float) -> dict[str, Any]:
        """All of it as plain values for JSON (no NaN)."""
        zero_s = max(self.measured.latest_s, self.predicted.latest_s)
        return {
            "topics": {name: one.health(now_s, self.latched[name]) for name, one in self.arrivals.items()},
            "speed": {"measured": self.measured.columns(zero_s), "predicted": self.predicted.columns(zero_s)},
            "values": {name: value if math.isfinite(value) else None for name, value in self.values.items()},
            "bed": dict(self.bed),
            "trial": dict(self.trial),
            "interlock": self.interlock,
            "pictures": dict(self.pictures),
        }


class Throttle:
    """True at most once per period."""

    def __init__(self, period_s: float, clock: Callable[[], float]) -> None:
        self._period_s, self._clock = period_s, clock
        self._next_s = -math.inf

    def __call__(self) -> bool:
        """Whether it is time again."""
        now_s = self._clock()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._period_s
        return True
