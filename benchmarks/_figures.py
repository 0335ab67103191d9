"""Figures beside their aims, as benchmarks/README.md shows them: of samples, and of whole reports."""

import json
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

STORED = Path(__file__).with_name("figures.json")
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
        number = f"{self.value:,.0f}" if abs(self.value) >= 100 else f"{self.value:.3g}"
        value = f"{number} {self._parts[2]}".strip()
        return f"| {self.what} | {self.of} | {value} | {self.aim} | {'reached' if self.reached else '**short**'} |"


def share(what: str, of: str, held: Sequence[bool], aim: str) -> list[Figure]:
    """For how many of a sample it held, in per cent; nothing of an empty one."""
    return [Figure(what, f"{sum(held)} of {len(held)} {of}", 100 * sum(held) / len(held), aim)] if held else []


def table(figures: Sequence[Figure]) -> str:
    """Markdown."""
    return "\n".join(["| what | of | measured | aim | |", "|---|---|---|---|---|", *(one.row() for one in figures)])


@dataclass(frozen=True)
class Run:
    """What one benchmark gave the last time."""

    how: str
    """``whole`` or ``a sample``."""
    took_s: float
    load: float
    """Average at its end."""
    commit: str
    figures: Sequence[Figure]

    def row(self) -> str:
        """Its cells in the table of reports, in Markdown."""
        return f"{self.how} | {self.took_s:.0f} s | {self.load:.0f} | {self.commit}"


def stored() -> dict[str, Run]:
    """What all gave the last time, by name."""
    if not STORED.is_file():
        return {}
    kept = json.loads(STORED.read_text(encoding="utf-8"))
    return {
        name: Run(**{**one, "figures": [Figure(**figure) for figure in one["figures"]]}) for name, one in kept.items()
    }


def store(runs: Mapping[str, Run]) -> None:
    """Keep them."""
    text = json.dumps({name: asdict(runs[name]) for name in sorted(runs)}, indent=1, ensure_ascii=False)
    STORED.write_text(text + "\n", encoding="utf-8")
