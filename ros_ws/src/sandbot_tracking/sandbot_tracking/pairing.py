"""Frames of several cameras taken at one instant, brought together again."""

from collections.abc import Sequence
from typing import Generic, TypeVar

T = TypeVar("T")

PATIENCE = 100
"""Instants that may wait for a partner before the oldest goes on without. After a stall of a busy machine one camera's
backlog is delivered before the other's, so a second's worth must be able to wait; a frame really lost costs no
waiting, for the next complete instant sends the ones before it on."""


class Pairing(Generic[T]):
    """Collects items by time stamp; gives out instants in order of time, each once."""

    def __init__(self, cameras: Sequence[str]) -> None:
        self._cameras = frozenset(cameras)
        self._waiting: dict[int, dict[str, T]] = {}
        self._given_ns: int | None = None

    def add(self, stamp_ns: int, camera: str, item: T) -> list[tuple[int, dict[str, T]]]:
        """The instants ready to go after this item: complete ones, and those given up waiting for.

        An item older than what was given out is dropped: its instant has gone without it.
        """
        if self._given_ns is not None and stamp_ns <= self._given_ns:
            return []
        self._waiting.setdefault(stamp_ns, {})[camera] = item
        complete = [stamp for stamp, items in self._waiting.items() if items.keys() >= self._cameras]
        ready = [stamp for stamp in sorted(self._waiting) if complete and stamp <= max(complete)]
        if not ready and len(self._waiting) > PATIENCE:
            ready = [min(self._waiting)]
        if ready:
            self._given_ns = ready[-1]
        return [(stamp, self._waiting.pop(stamp)) for stamp in ready]
