"""Pairs the views of two cameras: each frame of the first with those of the second before and after it.

Cameras with a common trigger do not have identical stamps. If the second's frame is slightly earlier, its next one is a
whole period away: instead of waiting, its view is extrapolated linearly from its last two frames to the first's time.
"""

from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Generic, TypeVar

T = TypeVar("T")

PATIENCE = 100
"""Frames that may wait for a partner before the oldest is released without one. After a stall of a busy machine one
camera's backlog is delivered before the other's, so frames must be able to wait for a second; a lost frame causes no
waiting, as the partner's next frame releases all earlier ones."""
SLACK = 1.5
"""Accepted time difference in tolerances: cameras half a period apart are always near the limit, and stamps jitter."""
LONGEST_GAP = 5
"""Longest time between two interpolated views, in tolerances: with one frame lost there are four."""
NEAR = 0.1
"""Longest extrapolation, in tolerances: a twentieth of a period, which increases the noise by at most a twentieth."""
RESTART_NS = 1_000_000_000
"""Times that go back by more than this restart the pairing, as in a replay that starts over."""

_time = itemgetter(0)


@dataclass(frozen=True)
class Instant(Generic[T]):
    """The views at one time; None: not seen.

    ``second``: two frames and the weight of the latter, 0 to 1 if they are before and after this time, slightly above 1
    if both are before it; a frame at exactly this time is given twice.
    """

    t_ns: int
    first: T | None
    second: tuple[T, T, float] | None


class Pairing(Generic[T]):
    """Collects the frames of one or two cameras; returns instants in order of time, each once.

    A frame of the second camera is returned alone if the first has none within the tolerance. Views are interpolated
    across the gap of at most one lost frame, and only if one of them is within the tolerance.
    """

    def __init__(self, cameras: Sequence[str], tolerance_ns: int) -> None:
        """``cameras``: the one whose times are used, and the other, if there is one."""
        self._first, self._second = cameras[0], cameras[1] if len(cameras) > 1 else None
        self._reach, self._longest_ns = SLACK * tolerance_ns, LONGEST_GAP * tolerance_ns
        self._near_ns, self._shortest_ns = NEAR * tolerance_ns, tolerance_ns
        self.late = 0
        """Frames that came after their instant had been returned."""
        self._restart()

    def _restart(self) -> None:
        self._waiting: dict[str, list[tuple[int, T]]] = {name: [] for name in (self._first, self._second) if name}
        self._past: list[tuple[int, T]] = []
        """The second camera's last two frames already used."""
        self._given_ns: int | None = None
        self._last_first_ns: int | None = None

    def add(self, t_ns: int, camera: str, item: T) -> list[Instant[T]]:
        """The instants that are ready after this frame. A frame older than the last returned is dropped and counted."""
        if self._given_ns is not None and t_ns <= self._given_ns:
            if t_ns > self._given_ns - RESTART_NS:
                self.late += camera == self._first
                # A late view of the second camera is the last one before the next instant.
                if camera == self._second and (not self._past or t_ns > self._past[-1][0]):
                    self._pass((t_ns, item))
                return []
            self._restart()
        insort(self._waiting[camera], (t_ns, item), key=_time)
        return self._ready()

    def _pass(self, *frames: tuple[int, T]) -> None:
        self._past = [*self._past, *frames][-2:]

    def _ready(self) -> list[Instant[T]]:
        given: list[Instant[T]] = []
        firsts = self._waiting[self._first]
        while firsts and self._decided(firsts):
            given += self._unpaired(firsts[0][0])
            t_ns, item = firsts.pop(0)
            given.append(Instant(t_ns, item, self._around(t_ns)))
            self._last_first_ns = t_ns
        if not firsts and self._second and len(self._waiting[self._second]) > PATIENCE:
            frame = self._waiting[self._second].pop(0)
            if frame[0] != self._last_first_ns:
                given.append(self._single(frame))
        if given:
            self._given_ns = given[-1].t_ns
        return given

    def _decided(self, firsts: list[tuple[int, T]]) -> bool:
        """Whether the other camera has reached the time of the oldest frame, or is no longer waited for."""
        if self._second is None or len(firsts) > PATIENCE:
            return True
        seconds = self._waiting[self._second]
        return bool(seconds) and seconds[-1][0] >= firsts[0][0] - self._near_ns

    def _unpaired(self, t_ns: int) -> list[Instant[T]]:
        """The second camera's frames before ``t_ns`` that are not near a frame of the first."""
        if self._second is None:
            return []
        seconds = self._waiting[self._second]
        before = seconds[: bisect_left(seconds, t_ns, key=_time)]
        del seconds[: len(before)]
        since = self._last_first_ns
        alone = [
            frame
            for frame in before
            if t_ns - frame[0] > self._reach and (since is None or frame[0] - since > self._reach)
        ]
        given = [Instant(when, None, (view, view, 0.0)) for when, view in alone]
        self._pass(*before)
        return given

    def _single(self, frame: tuple[int, T]) -> Instant[T]:
        self._pass(frame)
        return Instant(frame[0], None, (frame[1], frame[1], 0.0))

    def _around(self, t_ns: int) -> tuple[T, T, float] | None:
        seconds = self._waiting[self._second] if self._second else []
        if seconds and seconds[0][0] == t_ns:
            return seconds[0][1], seconds[0][1], 0.0
        if self._past and t_ns - self._past[-1][0] <= self._near_ns:
            return self._extrapolated(t_ns)
        if not seconds or not self._past:
            return None
        (before_ns, before), (after_ns, after) = self._past[-1], seconds[0]
        gap = after_ns - before_ns
        if after_ns < t_ns or min(t_ns - before_ns, after_ns - t_ns) > self._reach or gap > self._longest_ns:
            return None
        return before, after, (t_ns - before_ns) / gap

    def _extrapolated(self, t_ns: int) -> tuple[T, T, float]:
        (first_ns, first), (last_ns, last) = self._past[0], self._past[-1]
        gap = last_ns - first_ns
        if not self._shortest_ns <= gap <= self._longest_ns:
            return last, last, 0.0
        return first, last, (t_ns - first_ns) / gap
