"""The state of the running trackway that the console page shows, without ROS or HTTP. Pure.

Times are seconds of one steady clock, passed in. The node feeds it; ``snapshot`` is what the page draws. It covers only
the trial under way: measurements of the last one are cleared when /trial announces another.
"""

import json
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sandbot_bed.protocol import Stage
from sandbot_bringup.safety import Safety
from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.files import parse_json
from sandbot_common.health import has_ended
from sandbot_common.typed import number_or_nan
from sandbot_record.bags.recording import Limits

HISTORY_S = 5.0
"""How far back the speed plot reaches."""

RATE_WINDOW_S = 2.0
SILENT_S = 2.0
"""An expected topic without messages for this long is called silent."""
LOG_LINES = 200

ALWAYS = {topics.BED_HEIGHT.name, topics.BED_BLOWER.name, topics.BED_STATUS.name, topics.DIAGNOSTICS.name}
WALKING = {topic.name for topic in (topics.LEG_SETPOINTS, topics.LEG_STATES, topics.SPEED, *topics.LANDMARKS.values())}
"""Topics expected while legs move. On all other topics silence means nothing."""
PASSING = {"recorder", "campaign"}
"""Nodes that come and go."""
BUSY = tuple(stage for stage in Stage if stage.busy)


class Series:
    """The last ``HISTORY_S`` of one quantity against the time stamps of its messages [s]."""

    def __init__(self, history_s: float = HISTORY_S) -> None:
        self._history_s = history_s
        self._points: deque[tuple[float, float]] = deque()

    def add(self, t_s: float, value: float) -> None:
        """Append a point; a stamp before the last one (a new trial, a replay from the start) restarts the series."""
        if self._points and t_s < self._points[-1][0]:
            self._points.clear()
        self._points.append((t_s, value))
        while t_s - self._points[0][0] > self._history_s:
            self._points.popleft()

    def clear(self) -> None:
        """Start a new trial."""
        self._points.clear()

    @property
    def latest_s(self) -> float:
        """The last time stamp, minus infinity if there is none."""
        return self._points[-1][0] if self._points else -math.inf

    def columns(self, zero_s: float) -> dict[str, list[float | None]]:
        """Times relative to ``zero_s`` [s, not positive] and values; NaN becomes None, a gap in the plot."""
        return {
            "t_s": [round(t_s - zero_s, 4) for t_s, _ in self._points],
            "value": [round(value, 5) if math.isfinite(value) else None for _, value in self._points],
        }


class Arrivals:
    """Arrival times of the messages of one topic: their rate, and the age of the last one."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()
        self._first_s = math.inf

    def add(self, now_s: float) -> None:
        """A message has arrived."""
        self._first_s = min(self._first_s, now_s)
        self._times.append(now_s)
        self._forget(now_s)

    def health(self, now_s: float, latched: bool, expected_since_s: float = -math.inf) -> dict[str, Any]:
        """``state``, ``rate_hz`` and ``age_s``.

        State: waiting for the first message; ok; held for a latched topic that has had one; else silent if messages are
        expected (since ``expected_since_s``; infinite: they are not), and quiet if not.
        """
        if not math.isfinite(self._first_s):
            return {"state": "waiting", "rate_hz": 0.0, "age_s": None}
        self._forget(now_s)
        age_s = now_s - self._times[-1]
        heard = max(min(RATE_WINDOW_S, now_s - self._first_s), 0.5)
        recent = sum(1 for t_s in self._times if now_s - t_s <= RATE_WINDOW_S)
        missed = min(age_s, now_s - expected_since_s) > SILENT_S
        state = "held" if latched else "ok" if age_s <= SILENT_S else "silent" if missed else "quiet"
        return {"state": state, "rate_hz": round(recent / heard, 1), "age_s": round(age_s, 1)}

    def _forget(self, now_s: float) -> None:
        # The last one is kept, however old, as its age is needed.
        while len(self._times) > 1 and now_s - self._times[0] > RATE_WINDOW_S:
            self._times.popleft()


@dataclass
class Packing:
    """φ and height of the bed against pulses, in the current or last preparation."""

    points: list[dict[str, float]] = field(default_factory=list)
    _busy: bool = False

    def add(self, values: Mapping[str, str]) -> None:
        """Add the values of a /bed/status: a point for each φ measured after a pulse (or after fluidising)."""
        busy = values.get("stage") in BUSY
        if busy and not self._busy:
            self.points.clear()
        self._busy = busy
        figures = {
            key: number_or_nan(values.get(key)) for key in ("pulses", "refluidised", "phi", "phi_sd", "height_m")
        }
        if not math.isfinite(figures["phi"] + figures["height_m"]):
            return
        if values.get("stage") == "pulse":
            figures["pulses"] -= 1  # the current pulse began after φ was measured
        point = {key: value for key, value in figures.items() if math.isfinite(value)}
        last = self.points[-1] if self.points else {}
        if any(point.get(key) != last.get(key) for key in ("refluidised", "phi")):
            self.points.append(point)


@dataclass
class NodeHealth:
    """A node's last status on /diagnostics."""

    level: int
    text: str
    values: Mapping[str, str]
    heard_s: float

    def shown(self, name: str, now_s: float) -> dict[str, Any]:
        """Its state: ok, warning, error, gone (announced, or of a node that comes and goes) or silent."""
        silent = now_s - self.heard_s > SILENT_S
        gone = silent and (name in PASSING or has_ended(self.text))
        state = "gone" if gone else "silent" if silent else ("ok", "warning", "error", "error")[min(self.level, 3)]
        return {"state": state, "text": self.text, "age_s": round(now_s - self.heard_s, 1)}


class RecorderRate:
    """Bytes a second over the last two seconds, and how long the disk lasts at that."""

    def __init__(self) -> None:
        self._sizes: deque[tuple[float, float]] = deque()

    def add(self, size_bytes: float, now_s: float) -> None:
        """Add the bag's size; a smaller size means another bag."""
        if self._sizes and size_bytes < self._sizes[-1][1]:
            self._sizes.clear()
        self._sizes.append((now_s, size_bytes))
        while now_s - self._sizes[0][0] > RATE_WINDOW_S:
            self._sizes.popleft()

    def figures(self, free_bytes: float) -> dict[str, float | None]:
        """``rate_bytes_s`` and ``left_s`` until the recorder would stop; None if unknown."""
        if len(self._sizes) < 2 or self._sizes[-1][0] <= self._sizes[0][0]:
            return {"rate_bytes_s": None, "left_s": None}
        (t0, first), (t1, last) = self._sizes[0], self._sizes[-1]
        rate = (last - first) / (t1 - t0)
        left = (free_bytes - Limits.min_free) / rate if rate > 0 else math.nan
        return {"rate_bytes_s": round(rate), "left_s": round(max(left, 0.0)) if math.isfinite(left) else None}


@dataclass
class Console:
    """The state behind the page. Every method is cheap; the node calls them as messages arrive."""

    latched: Mapping[str, bool]
    arrivals: dict[str, Arrivals] = field(init=False)
    safety: Safety = field(default_factory=Safety)
    measured: Series = field(default_factory=Series)
    predicted: Series = field(default_factory=Series)
    packing: Packing = field(default_factory=Packing)
    values: dict[str, float] = field(default_factory=dict)
    bed: dict[str, str] = field(default_factory=dict)
    trial: dict[str, Any] = field(default_factory=dict)
    nodes: dict[str, NodeHealth] = field(default_factory=dict)
    recorder: RecorderRate = field(default_factory=RecorderRate)
    campaign: dict[str, Any] = field(default_factory=dict)
    curves: dict[str, Any] = field(default_factory=dict)
    pictures: dict[str, dict[str, Any]] = field(default_factory=dict)
    log: deque[Mapping[str, str]] = field(default_factory=lambda: deque(maxlen=LOG_LINES))
    _bed_s: float = -math.inf
    _campaign_s: float = -math.inf
    _walking_since_s: float = math.inf

    def __post_init__(self) -> None:
        self.arrivals = {name: Arrivals() for name in self.latched}

    def heard(self, topic: str, now_s: float) -> None:
        """Count a message of ``topic``."""
        self.arrivals[topic].add(now_s)

    def set_trial(self, text: str) -> None:
        """Set the content of /trial (JSON; other text is shown verbatim). A new trial clears all measurements."""
        content = _json(text, topics.TRIAL.name)
        trial = content if isinstance(content, dict) else {"trial_id": text}
        if (trial.get("trial_id"), trial.get("start")) != (self.trial.get("trial_id"), self.trial.get("start")):
            self.values.clear()
            self.measured.clear()
            self.predicted.clear()
            self.packing = Packing()
        if trial.get("campaign") != self.trial.get("campaign"):
            self.curves.clear()
        self.trial = trial

    def set_bed(self, values: Mapping[str, str], now_s: float) -> None:
        """Set the values of /bed/status."""
        self._bed_s = now_s
        self.bed.update(values)
        self.packing.add(values)

    def set_node(self, name: str, level: int, text: str, values: Mapping[str, str], now_s: float) -> None:
        """Set a node's status from /diagnostics."""
        self.nodes[name] = NodeHealth(level, text, values, now_s)
        if name == "clock":
            running = values.get("running") == "True"
            self.safety.on_clock(running, now_s)
            self._walking_since_s = min(self._walking_since_s, now_s) if running else math.inf
        if name == "recorder" and math.isfinite(size := number_or_nan(values.get("bytes"))):
            self.recorder.add(size, now_s)

    def set_campaign(self, text: str, now_s: float) -> None:
        """Set the content of campaign/status."""
        content = _json(text, topics.CAMPAIGN_STATUS.name)
        if isinstance(content, dict):
            self.campaign, self._campaign_s = content, now_s

    def set_curve(self, text: str) -> None:
        """Set the model's curve at the φ of a trial, stored under the trial's target φ."""
        content = _json(text, topics.MODEL_CURVE.name)
        if isinstance(content, dict) and "phi" in content:
            target = number_or_nan(self.trial.get("phi_target", content["phi"]))
            self.curves[f"{target:.4f}"] = content

    def new_picture(self, camera: str, seen: Sequence[str]) -> None:
        """A newer picture of ``camera`` is available, with the marks ``seen`` drawn in."""
        number = self.pictures.get(camera, {"number": 0})["number"] + 1
        self.pictures[camera] = {"number": number, "seen": list(seen)}

    def note(self, at: str, who: str, text: str) -> None:
        """One line of the log; ``at``: ISO 8601, UTC."""
        self.log.append({"at": at, "who": who, "text": text})

    def snapshot(self, now_s: float) -> dict[str, Any]:
        """The whole state as plain values for JSON (no NaN)."""
        zero_s = max(self.measured.latest_s, self.predicted.latest_s)
        safety = self.safety.statement(now_s)
        bed_age_s, campaign_age_s = now_s - self._bed_s, now_s - self._campaign_s
        return {
            "topics": {
                name: arrivals.health(now_s, self.latched[name], self._expected(name))
                for name, arrivals in self.arrivals.items()
            },
            "nodes": {name: one.shown(name, now_s) for name, one in sorted(self.nodes.items())},
            "speed": {"measured": self.measured.columns(zero_s), "predicted": self.predicted.columns(zero_s)},
            "values": {name: value if math.isfinite(value) else None for name, value in self.values.items()},
            "bed": _dated(self.bed, bed_age_s),
            "packing": {"points": self.packing.points, **self._target()},
            "trial": dict(self.trial),
            "safety": {"state": safety.state, "text": safety.text},
            "timing": self._timing(now_s),
            "recorder": self._recorder(now_s),
            "campaign": _dated(self.campaign, campaign_age_s) | {"age_s": round(campaign_age_s, 1)}
            if self.campaign
            else {},
            "curves": self.curves,
            "pictures": dict(self.pictures),
            "log": list(self.log),
        }

    def under_way(self, now_s: float) -> bool:
        """Whether legs or air are being commanded, as clock and bed report."""
        clock, bed = self._recent("clock", now_s), self._recent("bed", now_s)
        return clock.get("running") == "True" or bed.get("stage") in BUSY

    def _expected(self, topic: str) -> float:
        """Since when messages of a topic are expected; infinity if they are not."""
        return -math.inf if topic in ALWAYS else self._walking_since_s if topic in WALKING else math.inf

    def _recent(self, node: str, now_s: float) -> Mapping[str, str]:
        """A node's values on /diagnostics; empty if it is silent."""
        health = self.nodes.get(node)
        return health.values if health is not None and now_s - health.heard_s <= SILENT_S else {}

    def _target(self) -> dict[str, float | None]:
        health = self.nodes.get("bed")
        tolerance = number_or_nan(health.values.get("tolerance")) if health else math.nan
        target = number_or_nan(self.bed.get("target_phi"))
        return {"target_phi": _or_none(target), "tolerance": _or_none(tolerance)}

    def _timing(self, now_s: float) -> dict[str, str]:
        tracker, clock = self._recent("tracker", now_s), self._recent("clock", now_s)
        named = {
            "exposure to speed, median": (tracker, "latency_ms_median", "ms"),
            "99 %": (tracker, "latency_ms_p99", "ms"),
            "frames too late": (tracker, "missed_deadlines", ""),
            "set-points late by, 99 %": (clock, "late_p99_us", "µs"),
            "set-points missed": (clock, "missed_deadlines", ""),
        }
        return {
            name: f"{values[key]} {unit}".strip()
            for name, (values, key, unit) in named.items()
            if values.get(key) not in (None, "nan")
        }

    def _recorder(self, now_s: float) -> dict[str, float | None]:
        values = self._recent("recorder", now_s)
        if not values:
            return {}
        figures = {key: _or_none(number_or_nan(values.get(key))) for key in ("written", "lost", "bytes", "free_bytes")}
        return {**figures, **self.recorder.figures(figures["free_bytes"] or math.nan)}


def _json(text: str, where: str) -> Any:
    """The parsed text, None unless it is strict JSON: the page can't parse NaN."""
    try:
        content = parse_json(text, where)
        json.dumps(content, allow_nan=False)
    except (InputError, ValueError):
        return None
    return content


def _dated(status: Mapping[str, Any], age_s: float) -> dict[str, Any]:
    """The status, with the age of its stage if it is old: what legs and air do meanwhile may contradict it."""
    old = age_s > SILENT_S and status.get("stage")
    return {**status, "stage": f"{status['stage']}, {age_s:.0f} s ago"} if old else dict(status)


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


class Throttle:
    """True at most once per period."""

    def __init__(self, period_s: float, clock: Callable[[], float]) -> None:
        self._period_s, self._clock = period_s, clock
        self._next_s = -math.inf

    def __call__(self) -> bool:
        """Whether a period has passed."""
        now_s = self._clock()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._period_s
        return True
