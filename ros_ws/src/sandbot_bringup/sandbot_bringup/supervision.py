"""Which nodes must be heard from while a trial runs: pure; ``monitor_node`` feeds it, the clock is passed in.

Its clock counts the time the campaign listened (``Listening``): while a busy machine keeps the campaign itself from the
CPU, nobody counts as silent. Nor does the time count for which the machine kept the silent node from the CPU
(``Supervisor.starved``).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from sandbot_common import health, topics

LOOP = "its loop"
"""In place of a topic: any sign that a node's loop turns, its health or a heartbeat with a new loop time."""
FRAMES = "its frames"
"""In place of a topic: new pictures of a camera that reach the tracker, raw or compressed, not the last one again."""


@dataclass(frozen=True)
class Sign:
    """A sign of life: who gives it, on which topic (empty: any), and how long it may be absent [s]."""

    who: str
    topic: str
    limit_s: float

    @property
    def missing(self) -> str:
        """A phrase that says what is wrong if it is absent."""
        if self.topic == LOOP:
            return f"{self.who} is stuck: no sign of its loop for {self.limit_s:g} s"
        if self.topic == FRAMES:
            return f"{self.who} is silent: no new frame for {self.limit_s:g} s"
        where = f" on {self.topic}" if self.topic else ""
        return f"{self.who} is silent: nothing from it{where} for {self.limit_s:g} s"


@dataclass
class Listening:
    """Time spent listening [s]: it advances by at most ``most_s`` between two calls, however far apart they are."""

    most_s: float
    now_s: float = 0.0
    _looked_s: float = math.inf
    _held_s: float = 0.0
    _held_at_s: float = -math.inf

    def look(self, monotonic_s: float) -> None:
        """The listener is about to listen, at this time of a monotonic clock."""
        passed_s = max(monotonic_s - self._looked_s, 0.0)
        if passed_s > HELD_UP_S:
            self._held_s, self._held_at_s = passed_s, self.now_s
        self.now_s += min(passed_s, self.most_s)
        self._looked_s = monotonic_s

    @property
    def held_up(self) -> str:
        """How long the listener was held up just now, so that its lease may have been lost; empty if it was not."""
        recent = self.now_s - self._held_at_s < EXPLAINS_S
        return f"the campaign was held up for {self._held_s:.2g} s" if recent else ""


HELD_UP_S, EXPLAINS_S = 0.25, 2.0
"""A campaign held up for longer loses its lease; for this long afterwards a silence is attributed to that."""
SILENCE_S, SILENCE_BOUNDS_S, BEATS = 1.0, (0.3, 10.0), 4
"""A node whose loop shows no sign for this long during a trial is stuck. On this host the system reports whether its
process lives; on another it sends 20 heartbeats a second, and is dead if there is none for a quarter of this time."""
PACE = 0.4
"""Largest relative deviation of a camera's frame rate from the calibration's: a driver on a busy machine takes 43
frames of 50 at rest; a camera set to another rate deviates by more."""
OUT_OF_STEP = 0.5
"""Fraction of views without a partner beyond which only a wrong clock, not lost frames, can explain them."""
FEW_FRAMES = 3
"""A camera is silent after this many periods at the earliest, however slow it is."""
_NEVER = (-math.inf, 0.0)


@dataclass
class Supervisor:
    """Reports who has fallen silent. Silence counts at the earliest from the moment a sign is watched for."""

    _heard_s: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    _starved_s: dict[str, float] = field(default_factory=dict)
    _watched: dict[Sign, float] = field(default_factory=dict)

    def heard(self, who: str, topic: str, now_s: float) -> None:
        """A sign of life was received."""
        self._heard_s[who, topic] = self._heard_s[who, ""] = now_s, self._starved_s.get(who, 0.0)

    def starved(self, who: str, more_s: float) -> None:
        """The machine kept it from the CPU for this long, which does not count as silence."""
        self._starved_s[who] = self._starved_s.get(who, 0.0) + more_s

    def heard_since(self, who: str, topic: str, since_s: float) -> bool:
        """Whether a sign was received after that time."""
        return self._heard_s.get((who, topic), _NEVER)[0] > since_s

    def age_s(self, who: str, topic: str, now_s: float) -> float:
        """Time since the last sign (topic empty: of any kind), less the time without CPU; infinite before the first."""
        heard_s, starved_s = self._heard_s.get((who, topic), _NEVER)
        return now_s - heard_s - (self._starved_s.get(who, 0.0) - starved_s)

    def watch(self, *signs: Sign, now_s: float) -> None:
        """Watch for these signs, and no others, from now on."""
        self._watched = {sign: self._watched.get(sign, now_s) for sign in signs}

    def silent(self, now_s: float) -> str:
        """A phrase that names who is silent; an empty string if nobody is."""
        for sign, since_s in self._watched.items():
            if min(self.age_s(sign.who, sign.topic, now_s), now_s - since_s) > sign.limit_s:
                return sign.missing
        return ""


def pace_fault(before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """What is wrong with rate or synchronisation of the cameras, from two of the tracker's statuses; empty: nothing."""
    for camera in topics.VIEWS:
        if health.of_camera(camera, health.CALIBRATED_MS) not in after:
            continue
        if not _of(camera, health.FRAMES, after) > _of(camera, health.FRAMES, before):
            return f"the {camera} camera sends no new frames"
        period_ms, calibrated_ms = (_of(camera, what, after) for what in (health.PERIOD_MS, health.CALIBRATED_MS))
        if period_ms > 0 and calibrated_ms > 0 and abs(period_ms / calibrated_ms - 1.0) > PACE:
            rate, calibrated = 1e3 / period_ms, 1e3 / calibrated_ms
            return f"the {camera} camera takes {rate:.3g} frames a second, cameras.yaml says {calibrated:.3g}"
    # Before the LED's first flash the offset between the cameras' clocks is unknown.
    if all(after.get(health.of_camera(camera, health.CLOCK)) == health.BY_THE_LED for camera in topics.VIEWS):
        shared = health.of_camera("dorsal", health.FRAMES), health.LOST_FRAMES
        frames, lost = (health.figure(after, what) - health.figure(before, what) for what in shared)
        if lost > OUT_OF_STEP * frames:
            views = f"{lost:.0f} views without a partner for {frames:.0f} dorsal frames"
            return f"the cameras are out of step, {views}: restart the tracker if a camera's clock was set"
    return ""


def frames_came(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """The cameras of which the tracker has counted new frames between two of its statuses."""
    return [view for view in topics.VIEWS if _of(view, health.FRAMES, after) > _of(view, health.FRAMES, before)]


def camera_silence_s(camera: str, values: Mapping[str, str], silence_s: float) -> float:
    """How long a camera of this calibrated period, in the tracker's status, may send no new frame [s]."""
    return max(silence_s, FEW_FRAMES * _of(camera, health.CALIBRATED_MS, values) / 1e3)


def _of(camera: str, what: str, values: Mapping[str, str]) -> float:
    return health.figure(values, health.of_camera(camera, what))
