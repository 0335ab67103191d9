"""The host's wall clock as seen from CLOCK_MONOTONIC, which nobody sets.

Both run at the same rate (NTP slews them together), so their difference changes only when the wall clock is set. A
reading between two of the monotonic clock bounds it, however long the process is held up in between.
"""

import time
from datetime import UTC, datetime

from sandbot_common.errors import InputError

_ROUNDING_NS = 1000
_FIRST_YEAR = 2000
"""A board without a battery begins in 1970 until NTP has set its clock."""


def never_set(moment: datetime) -> bool:
    """Whether a time of day is that of a clock which nobody has set yet."""
    return moment.year < _FIRST_YEAR


def check_set(now_s: float) -> None:
    """Raise InputError if nobody has set the host's clock yet, which shows ``now_s`` since 1970."""
    if never_set(now := datetime.fromtimestamp(now_s, UTC)):
        raise InputError(
            f"the host's clock shows {now:%Y-%m-%d}, so it has not been set yet, and trials would be put in a wrong "
            "order; wait for NTP, or set it with timedatectl"
        )


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
