"""Mean speed and lift of each whole leg period, as it ends: what a person watches while a trial runs."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class PeriodMean:
    """One period. NaN where the markers were not seen."""

    speed_m_s: float
    lift_m: float


class PeriodMeans:
    """Fed sample by sample; the rest height is the lowest axle height so far."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """A trial begins: forget rest height and phase."""
        self._rest_m = math.inf
        self._origin: float | None = None
        self._turns = 0
        self._start: tuple[float, float] | None = None
        self._top_m = -math.inf

    def update(self, t_s: float, x_m: float, z_m: float, advance_rad: float) -> PeriodMean | None:
        """The period that has just ended, or None. ``advance_rad``: how far the legs have turned."""
        if self._origin is None or advance_rad < self._origin:
            self._origin = advance_rad
        if math.isfinite(z_m):
            self._rest_m, self._top_m = min(self._rest_m, z_m), max(self._top_m, z_m)
        turns = int((advance_rad - self._origin) // (2 * math.pi))
        if self._start is None:
            self._start = (t_s, x_m)
        if turns == self._turns:
            return None
        then, x_then = self._start
        done = PeriodMean((x_m - x_then) / (t_s - then) if t_s > then else math.nan, self._lift())
        self._turns, self._start, self._top_m = turns, (t_s, x_m), -math.inf
        return done

    def _lift(self) -> float:
        return self._top_m - self._rest_m if math.isfinite(self._top_m) else math.nan
