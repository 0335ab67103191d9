"""Trials that fail one after another of one cause: pure. More of the same would measure nothing either."""

import re
from dataclasses import dataclass

ALIKE = 5
"""So many in a row are no chance: of a machine that spoils one trial in four five running are one in a thousand."""
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass
class Streak:
    """Reasons are alike where they differ in numbers only: times, positions, the trial's name."""

    _cause: str = ""
    _count: int = 0

    def end(self) -> None:
        """A trial went well, or somebody has seen to it."""
        self._cause, self._count = "", 0

    def failed(self, reason: str) -> str:
        """A trial failed; why the next ones would, too, or an empty string."""
        cause = _NUMBER.sub("#", reason)
        self._count = self._count + 1 if cause == self._cause else 1
        self._cause = cause
        return f"{self._count} trials in a row failed alike, the last: {reason}" if self._count >= ALIKE else ""
