"""Statistics of a camera's time stamps: frame period, jitter, and frames dropped, doubled, repeated or out of order."""

from collections import deque

import numpy as np

RECENT = 200
"""Number of recent frames that are kept."""
ENOUGH = 20
"""Number of intervals from which the period is measured instead of taken from the calibration."""
PAUSE_NS = 1_000_000_000
"""A camera silent for longer was stopped: no frames are counted as dropped."""


class FrameTimes:
    """Counts every stamp of one camera, given in order of arrival."""

    def __init__(self, period_s: float) -> None:
        """``period_s``: time between frames by the calibration, used until enough frames were seen."""
        self.calibrated_s = period_s
        self._stamps: deque[int] = deque(maxlen=RECENT)
        self._steps: deque[float] = deque(maxlen=RECENT)
        self._newest: int | None = None
        self.frames = self.dropped = self.doubled = self.repeated = self.late = 0

    def add(self, t_ns: int, *, repeated: bool = False) -> bool:
        """Count one frame; False if its stamp is a duplicate, or its picture that of the frame before (``repeated``):
        such a frame measures nothing, so it counts neither as a frame nor for the rate.
        """
        if t_ns in self._stamps:
            self.doubled += 1
            return False
        if repeated:
            self.repeated += 1
            return False
        self.frames += 1
        step_ns = 0 if self._newest is None else t_ns - self._newest
        if abs(step_ns) > PAUSE_NS:
            self._stamps.clear()
        elif step_ns < 0:
            # It was counted as dropped but came late.
            self.late, self.dropped = self.late + 1, max(0, self.dropped - 1)
        elif step_ns > 0:
            self.dropped += max(0, round(step_ns * 1e-9 / self.period_s) - 1)
            self._steps.append(step_ns * 1e-9)
        self._stamps.append(t_ns)
        if not -PAUSE_NS <= step_ns < 0:
            self._newest = t_ns
        return True

    @property
    def period_s(self) -> float:
        """Time between two frames: the median of recent intervals, which is robust against dropped frames."""
        return float(np.median(self._steps)) if len(self._steps) >= ENOUGH else self.calibrated_s

    @property
    def jitter_s(self) -> float:
        """Standard deviation of a stamp about equidistant times, from the median absolute deviation; NaN if too few."""
        if len(self._steps) < ENOUGH:
            return float("nan")
        steps = np.array(self._steps)
        deviation = steps - self.period_s * np.maximum(1, np.round(steps / self.period_s))
        # A step is the difference of two stamps.
        return float(1.4826 * np.median(np.abs(deviation)) / np.sqrt(2))
