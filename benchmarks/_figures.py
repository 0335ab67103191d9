"""Figures beside their aims, as benchmarks/README.md shows them: of samples, and of whole reports."""

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

SIGNS: dict[str, Callable[[float, float], bool]] = {"≥": operator.ge, "≤": operator.le, "<": operator.lt}


@dataclass(frozen=True)
class Figure:
    """One figure. ``value`` in the unit of ``aim``, which is a sign, a number and a unit: ``≤ 5 ms``, ``≥ 95 %``."""

    what: str
    of: str
    """Of what it was measured: a sample, or beside whom."""
    value: float
    aim: str

    @property
    def reached(self) -> bool:
        """Whether the aim is."""
        sign, number = self._parts[:2]
        return SIGNS[sign](self.value, float(number))

    @property
    def _parts(self) -> Sequence[str]:
        found = re.fullmatch(r"([≥≤<]) ([\d.]+) ?(.*)", self.aim)
        assert found is not None, self.aim
        return found.groups()

    def row(self) -> str:
        """A row of the table, in Markdown."""
        value = f"{self.value:.3g} {self._parts[2]}".strip()
        return f"| {self.what} | {self.of} | {value} | {self.aim} | {'reached' if self.reached else '**short**'} |"


def share(what: str, of: str, held: Sequence[bool], aim: str) -> list[Figure]:
    """For how many of a sample it held, in per cent; nothing of an empty one."""
    return [Figure(what, f"{sum(held)} of {len(held)} {of}", 100 * sum(held) / len(held), aim)] if held else []


def table(figures: Sequence[Figure]) -> str:
    """Markdown."""
    return "\n".join(["| what | of | measured | aim | |", "|---|---|---|---|---|", *(one.row() for one in figures)])
