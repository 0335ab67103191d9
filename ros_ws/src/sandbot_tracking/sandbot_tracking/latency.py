"""Delay from a frame's exposure to the publication of its speed, and how often it was too long."""

from collections import deque

import numpy as np

RECENT = 1000
NOT_LIVE_S = 60.0
"""Frames older than this are a replay and are not counted."""
TOO_OFTEN = 0.01
"""Fraction of missed deadlines from which there is a warning."""


class Latency:
    """Collects one delay [s] per frame."""

    def __init__(self, budget_s: float) -> None:
        self._budget_s = budget_s
        self.restart()

    def restart(self) -> None:
        """Start again, as a trial begins."""
        self._recent: deque[float] = deque(maxlen=RECENT)
        self.frames = self.missed = 0

    def add(self, delay_s: float) -> None:
        """Add the delay of one frame."""
        if delay_s > NOT_LIVE_S:
            return
        self._recent.append(delay_s)
        self.frames += 1
        self.missed += delay_s > self._budget_s

    @property
    def warning(self) -> str:
        """A warning if too many frames were late, else empty."""
        if not self.frames or self.missed <= TOO_OFTEN * self.frames:
            return ""
        return f"{self.missed} of {self.frames} frames were later than {self._budget_s * 1e3:g} ms"

    def values(self) -> dict[str, object]:
        """Median and 99th percentile (nan: no frame yet) and missed deadlines, for /diagnostics."""
        figures = {"latency_ms_median": "nan", "latency_ms_p99": "nan"}
        if self._recent:
            median, p99 = np.quantile(self._recent, (0.5, 0.99)) * 1e3
            figures = {"latency_ms_median": f"{median:.2f}", "latency_ms_p99": f"{p99:.2f}"}
        return {**figures, "missed_deadlines": self.missed}
