"""Detects consecutive trials that fail for the same cause: pure. Further trials would fail as well."""

import re
from dataclasses import dataclass

ALIKE = 5
"""This many in a row are no coincidence: if one trial in four fails at random, five in a row have a chance of 1e-3."""
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass
class Streak:
    """Two reasons have the same cause if they differ only in numbers: times, positions, the trial's name."""

    _cause: str = ""
    _count: int = 0

    def end(self) -> None:
        """A trial succeeded, or the operator has taken over."""
        self._cause, self._count = "", 0

    def failed(self, reason: str) -> str:
        """A trial failed; returns why the next ones would fail, too, or an empty string."""
        cause = _NUMBER.sub("#", reason)
        self._count = self._count + 1 if cause == self._cause else 1
        self._cause = cause
        return f"{self._count} trials in a row failed alike, the last: {reason}" if self._count >= ALIKE else ""
