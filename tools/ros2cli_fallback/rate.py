"""The figures that ``ros2 topic hz`` prints, from arrival times alone."""

import math
from collections import deque
from dataclasses import dataclass

NANO = 1e9
PRINT_PERIOD_NS = 1_000_000_000


@dataclass(frozen=True)
class Figures:
    """Rate [Hz] and intervals between messages [s] over a window of intervals."""

    rate_hz: float
    min_s: float
    max_s: float
    std_dev_s: float
    window: int

    def __str__(self) -> str:
        return (
            f"average rate: {self.rate_hz:.3f}\n"
            f"\tmin: {self.min_s:.3f}s max: {self.max_s:.3f}s std dev: {self.std_dev_s:.5f}s window: {self.window}"
        )


class Rate:
    """Arrival times [ns] in, figures out: the last ``window`` intervals, at most once a second of arrivals."""

    def __init__(self, window: int) -> None:
        self._intervals_ns: deque[int] = deque(maxlen=window)
        self._last_ns: int | None = None
        self._printed_ns: int | None = None

    def add(self, t_ns: int) -> None:
        """A message has arrived; a clock that stepped back starts the window anew."""
        if self._last_ns is not None and t_ns >= self._last_ns:
            self._intervals_ns.append(t_ns - self._last_ns)
        else:
            self._intervals_ns.clear()
            self._printed_ns = t_ns
        self._last_ns = t_ns

    def due(self) -> Figures | None:
        """The figures if a second of arrivals has passed since the last ones, otherwise None."""
        if self._last_ns is None or self._printed_ns is None or not self._intervals_ns:
            return None
        if self._last_ns < self._printed_ns + PRINT_PERIOD_NS:
            return None
        self._printed_ns = self._last_ns
        count = len(self._intervals_ns)
        mean = sum(self._intervals_ns) / count
        variance = sum((one - mean) ** 2 for one in self._intervals_ns) / count
        return Figures(
            rate_hz=NANO / mean if mean > 0 else 0.0,
            min_s=min(self._intervals_ns) / NANO,
            max_s=max(self._intervals_ns) / NANO,
            std_dev_s=math.sqrt(variance) / NANO,
            window=count,
        )
