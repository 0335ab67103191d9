"""The host's wall clock as seen from CLOCK_MONOTONIC, which nobody sets.

Both run at the same rate (NTP slews them together), so their difference changes only when the wall clock is set. A
reading between two of the monotonic clock bounds it, however long the process is held up in between.
"""

import time

_ROUNDING_NS = 1000


class HostClock:
    """Knows bounds of the difference, narrowed by every look until the clock is set; any thread may look."""

    def __init__(self) -> None:
        self._bounds_ns = _difference_ns()

    def look(self) -> int:
        """By how much the wall clock was set since the last look [ns]; 0 if it was not."""
        known, now = self._bounds_ns, _difference_ns()
        both = max(known[0], now[0]), min(known[1], now[1])
        was_set = both[0] > both[1] + _ROUNDING_NS
        self._bounds_ns = now if was_set else both
        return sum(now) // 2 - sum(known) // 2 if was_set else 0

    def ahead_ns(self) -> int:
        """How far the wall clock is ahead of the monotonic one."""
        self.look()
        return sum(self._bounds_ns) // 2


def _difference_ns() -> tuple[int, int]:
    """The least and the most by which the wall clock can be ahead."""
    before_ns, wall_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
    return wall_ns - after_ns, wall_ns - before_ns
