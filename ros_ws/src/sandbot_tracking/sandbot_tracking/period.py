"""Mean speed and lift of each whole leg period as it ends, for display while a trial runs."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from sandbot_tracking.trial import position_at

TURN = 2 * math.pi
REMEMBERED = 200
"""Frames kept to find the position at a period's end."""
REACH = 0.11
"""Fraction of a step after a period's end that must be seen: slightly more than ``position_at`` uses."""


@dataclass(frozen=True)
class PeriodMean:
    """One period. NaN where markers were missing."""

    speed_m_s: float
    lift_m: float


class PeriodMeans:
    """Takes samples one by one; the rest height is the lowest axle height so far.

    A period ends when the legs have made a whole turn, between two frames. The body's position at that time is found as
    for the trials table (``trial.position_at``), so the period means are consistent with the table's speed.
    """

    def __init__(self) -> None:
        self._t: deque[float] = deque(maxlen=REMEMBERED)
        self._x: deque[float] = deque(maxlen=REMEMBERED)
        self._rest_m = math.inf
        self._top_m = -math.inf
        self._turns = 0
        self._origin_rad: float | None = None
        self._turned = 0.0
        self._start = (math.nan, math.nan)
        self._ends: deque[tuple[float, float]] = deque()
        """End time and largest axle height of each period that waits for the frames after its end."""

    def update(self, t_s: float, x_m: float, z_m: float, advance_rad: float) -> PeriodMean | None:
        """The period that ended shortly before, or None. ``advance_rad``: how far the legs have turned at ``t_s``."""
        if self._origin_rad is None:
            self._origin_rad, self._start = advance_rad, (t_s, x_m)
        if math.isfinite(z_m):
            self._rest_m, self._top_m = min(self._rest_m, z_m), max(self._top_m, z_m)
        before, self._turned = self._turned, advance_rad - self._origin_rad
        if self._turned >= (self._turns + 1) * TURN:
            self._turns = int(self._turned // TURN)
            share = (self._turns * TURN - before) / (self._turned - before)
            self._ends.append((self._t[-1] + share * (t_s - self._t[-1]), self._top_m))
            self._top_m = -math.inf
        self._t.append(t_s)
        self._x.append(x_m)
        return self._mean(t_s)

    def _mean(self, t_s: float) -> PeriodMean | None:
        if not self._ends:
            return None
        end_s, top_m = self._ends[0]
        step_s = (end_s - self._start[0]) / 2
        frame_s = t_s - self._t[-2]
        if t_s < end_s + max(REACH * step_s, 1.02 * frame_s):
            return None
        self._ends.popleft()
        then, x_then = self._start
        x = position_at(np.array(self._t), np.array(self._x), end_s, step_s)
        self._start = end_s, x
        return PeriodMean((x - x_then) / (end_s - then), top_m - self._rest_m if top_m > -math.inf else math.nan)
