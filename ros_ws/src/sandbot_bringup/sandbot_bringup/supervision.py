"""Who must be heard from while a trial runs: pure; ``hearing_node`` feeds it, the clock is passed in.

Its clock is the time the campaign listened (``Listening``): where a busy machine keeps the campaign itself from the
CPU, nobody is taken for silent, and the more it does so the more patient the campaign is. Nor does time count for which
the machine kept the one who is silent (``Supervisor.starved``).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

LOOP = "its loop"
"""In place of a topic: whatever shows that a node's loop turns, its health or a beat that says so."""


@dataclass(frozen=True)
class Sign:
    """A sign of life: who gives it, on which topic (empty: any), and how long it may stay away [s]."""

    who: str
    topic: str
    limit_s: float

    @property
    def missing(self) -> str:
        """One phrase of what is wrong where it stays away."""
        if self.topic == LOOP:
            return f"{self.who} is stuck: no sign of its loop for {self.limit_s:g} s"
        where = f" on {self.topic}" if self.topic else ""
        return f"{self.who} is silent: nothing from it{where} for {self.limit_s:g} s"


@dataclass
class Listening:
    """Time spent listening [s]: between two looks it goes on by ``most_s`` at most, however long they are apart."""

    most_s: float
    now_s: float = 0.0
    _looked_s: float = math.inf
    _held_s: float = 0.0
    _held_at_s: float = -math.inf

    def look(self, monotonic_s: float) -> None:
        """Somebody is about to listen, at this time of a monotonic clock."""
        passed_s = max(monotonic_s - self._looked_s, 0.0)
        if passed_s > HELD_UP_S:
            self._held_s, self._held_at_s = passed_s, self.now_s
        self.now_s += min(passed_s, self.most_s)
        self._looked_s = monotonic_s

    @property
    def held_up(self) -> str:
        """How long the listener was away just now, where others may have lost his lease over it; empty: he was not."""
        recent = self.now_s - self._held_at_s < EXPLAINS_S
        return f"the campaign was held up for {self._held_s:.2g} s" if recent else ""


HELD_UP_S, EXPLAINS_S = 0.25, 2.0
"""A campaign held up for longer loses its lease; for this long afterwards a silence is blamed on that."""
SILENCE_S, SILENCE_BOUNDS_S, BEATS = 1.0, (0.3, 10.0), 4
"""A node whose loop shows no sign for so long while a trial runs is stuck. Whether its process lives the system tells
where it runs on this host; elsewhere it beats 20 times a second, and a quarter of this without a beat, it is dead."""
PACE = 0.4
"""Part by which a camera's frame rate may be off the calibration's: a driver on a busy machine takes 43 frames of 50 at
rest; a camera set to another rate is off by more."""
OUT_OF_STEP = 0.5
"""Share of views without a partner beyond which no loss of frames, only a wrong clock, explains them."""
_NEVER = (-math.inf, 0.0)


@dataclass
class Supervisor:
    """Tells who has fallen silent. Silence counts from the moment a sign is asked for, at the earliest."""

    _heard_s: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    _starved_s: dict[str, float] = field(default_factory=dict)
    _watched: dict[Sign, float] = field(default_factory=dict)

    def heard(self, who: str, topic: str, now_s: float) -> None:
        """A sign of life."""
        self._heard_s[who, topic] = self._heard_s[who, ""] = now_s, self._starved_s.get(who, 0.0)

    def starved(self, who: str, more_s: float) -> None:
        """The machine kept him from the CPU for so long: that is not his silence."""
        self._starved_s[who] = self._starved_s.get(who, 0.0) + more_s

    def heard_since(self, who: str, topic: str, since_s: float) -> bool:
        """Whether a sign came after that time."""
        return self._heard_s.get((who, topic), _NEVER)[0] > since_s

    def age_s(self, who: str, topic: str, now_s: float) -> float:
        """Time since the last sign (topic empty: of any kind) in which he could have given one; infinite before it."""
        heard_s, starved_s = self._heard_s.get((who, topic), _NEVER)
        return now_s - heard_s - (self._starved_s.get(who, 0.0) - starved_s)

    def watch(self, *signs: Sign, now_s: float) -> None:
        """Ask for these signs, and no others, from now on."""
        self._watched = {sign: self._watched.get(sign, now_s) for sign in signs}

    def silent(self, now_s: float) -> str:
        """Who is silent, in one phrase; an empty string if nobody is."""
        for sign, since_s in self._watched.items():
            if min(self.age_s(sign.who, sign.topic, now_s), now_s - since_s) > sign.limit_s:
                return sign.missing
        return ""


def pace_fault(before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """What is wrong with rate or step of the cameras, from the tracker's health at two moments; empty: nothing."""
    for camera in ("dorsal", "lateral"):
        if f"{camera}_calibrated_ms" not in after:
            continue
        if int(after[f"{camera}_frames"]) <= int(before.get(f"{camera}_frames", 0)):
            return f"the {camera} camera sends no frames"
        period_ms, calibrated_ms = (float(after[f"{camera}_{what}"]) for what in ("period_ms", "calibrated_ms"))
        if abs(period_ms / calibrated_ms - 1.0) > PACE:
            rate, calibrated = 1e3 / period_ms, 1e3 / calibrated_ms
            return f"the {camera} camera takes {rate:.3g} frames a second, cameras.yaml says {calibrated:.3g}"
    # Before its first flash an LED has told nobody how far the clocks of two cameras are apart.
    if all(after.get(f"{camera}_clock") == "by the LED" for camera in ("dorsal", "lateral")):
        frames, lost = (int(after[what]) - int(before.get(what, 0)) for what in ("dorsal_frames", "lost_frames"))
        if lost > OUT_OF_STEP * frames:
            views = f"{lost} views without a partner for {frames} dorsal frames"
            return f"the cameras are out of step, {views}: restart the tracker if a camera's clock was set"
    return ""


def camera_fault(before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """Why a trial's camera times can't be trusted, from the tracker's health before and after it; empty if they can.

    A camera that has seen the LED of an earlier trial must see that of this one. One that never saw any has none in
    view, or films from the flash on, as the virtual lab's do in the first trial.
    """
    for camera in ("dorsal", "lateral"):
        edges, edges_after, jumps, jumps_after = (
            int(values.get(f"{camera}_{what}", 0))
            for what in ("led_edges", "clock_jumps")
            for values in (before, after)
        )
        if jumps_after > jumps:
            return f"the {camera} camera's clock disagrees with the LED (clock_jumps)"
        if edges and edges_after == edges:
            return f"the {camera} camera did not see the LED, so its clock is not sure"
    return ""
