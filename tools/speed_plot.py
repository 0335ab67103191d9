"""Plots a live speed as lines of text, half a second per line and 20 ms per column, for a terminal or a log."""

import math
from collections.abc import Iterator

BLOCKS = " ▁▂▃▄▅▆▇█"
LINE_S, COLUMNS, TOP_M_S = 0.5, 25, 0.3
"""A line, its columns, and the speed at which a column is full."""


class SpeedPlot:
    """Collects speeds and returns each line when it is full."""

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._columns: list[list[float]] = [[] for _ in range(COLUMNS)]
        self._line = 0

    def add(self, t_s: float, v_m_s: float) -> Iterator[str]:
        """Add a speed; returns the lines that are now full. Time counts from the first speed.

        One that is not a number, as where a marker was hidden or its frame was late, leaves a gap.
        """
        if self._begun_s is None:
            self._begun_s = t_s
        # Rounded: 0.58 s after the first is the 29th column, despite rounding errors of the stamps.
        place = int(round((t_s - self._begun_s) * COLUMNS / LINE_S, 6))
        while place // COLUMNS > self._line:
            yield from self.rest()
            self._line += 1
        if math.isfinite(v_m_s):
            self._columns[place % COLUMNS].append(v_m_s)

    def rest(self) -> Iterator[str]:
        """The last, incomplete line, if it is not empty."""
        speeds = [v for column in self._columns for v in column]
        if speeds:
            bars = "".join(_bar(column) for column in self._columns)
            yield f"  {(self._line + 1) * LINE_S:4.1f} s  {100 * sum(speeds) / len(speeds):5.1f} cm/s  |{bars}|"
        self._columns = [[] for _ in range(COLUMNS)]


def _bar(speeds: list[float]) -> str:
    if not speeds:
        return BLOCKS[0]
    # A measured speed is never blank: at rest a column has the lowest block.
    height = (len(BLOCKS) - 1) * sum(speeds) / len(speeds) / TOP_M_S
    return BLOCKS[min(max(round(height), 1), len(BLOCKS) - 1)]
