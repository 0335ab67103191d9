"""Numbers and tables as text: as many digits as the error allows, never a silent NaN."""

import html
import math
import textwrap
from collections.abc import Sequence

from sandbot_common import terminal
from sandbot_common.terminal import counted as counted
from sandbot_model.physics.observables import CM

UNKNOWN = "not known"
UNDETERMINED = "not determined"
"""Shown for a parameter whose error the data do not determine."""
NO_ERROR = (
    "no standard error where the model shows lack of fit, can't be tested, or has an effect at the end of its range"
)
WIDTH = 100
"""Greatest width of a line of text [columns]."""

Rows = Sequence[Sequence[str]]
"""A table; its first row is the head."""


def cm_s(value_m_s: float) -> str:
    """A speed [m/s] in cm/s: ``4.11 cm/s``."""
    return f"{CM * value_m_s:.2f} cm/s" if math.isfinite(value_m_s) else UNKNOWN


def probability(p: float) -> str:
    """A p-value: ``0.43``, ``< 0.001``."""
    if not math.isfinite(p):
        return UNKNOWN
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def to_error(value: float, error: float) -> str:
    """A value without its error, rounded by the rule of the Particle Data Group: to two digits of the error where its
    first two digits are 35 or less, else to one. ``–`` where the value is not known.
    """
    if not math.isfinite(value):
        return "–"
    if not math.isfinite(error) or error <= 0.0:
        return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
    return f"{value:.{min(max(0, -math.floor(math.log10(error / 3.55))), 9)}f}"


def with_error(value: float, stderr: float) -> str:
    """Value ± standard error, rounded to two digits of the error: ``0.401 ± 0.012``; no number without its error."""
    if not math.isfinite(value):
        return UNKNOWN
    if not math.isfinite(stderr) or stderr <= 0.0:
        return UNDETERMINED
    decimals = max(0, 1 - math.floor(math.log10(stderr)))
    return f"{value:.{decimals}f} ± {stderr:.{decimals}f}"


def with_unit(value: str, unit: str) -> str:
    """The text of a value with its unit: ``0.401 ± 0.012 s``, ``0.4 s, held``; without, where it is no number."""
    number, comma, remark = value.partition(",")
    return f"{number} {unit}".rstrip() + comma + remark if number[-1].isdigit() else value


def table(rows: Rows, left: Sequence[int] = (0,)) -> str:
    """Rows of text in aligned columns, ``left`` ones to the left, others to the right; the first row is underlined.

    A cell may have several lines; those of the first row are aligned at the bottom.
    """
    deep = max(cell.count("\n") + 1 for cell in rows[0])
    rows = [
        *_lines([("\n" * (deep - 1 - cell.count("\n"))) + cell for cell in rows[0]]),
        *(line for row in rows[1:] for line in _lines(row)),
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if column in left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    return "\n".join([*lines[:deep], "  ".join("-" * width for width in widths).rstrip(), *lines[deep:]])


def _lines(row: Sequence[str]) -> list[list[str]]:
    """A row of cells with several lines as rows of one line each."""
    cells = [cell.split("\n") for cell in row]
    return [[cell[at] if at < len(cell) else "" for cell in cells] for at in range(max(map(len, cells), default=0))]


def wrapped(rows: Rows) -> list[list[str]]:
    """The same rows, the last column wrapped so that the table is no wider than a terminal."""
    taken = sum(max(map(len, column)) + 2 for column in zip(*(row[:-1] for row in rows), strict=True))
    found = []
    for row in rows:
        first, *more = textwrap.wrap(row[-1], max(terminal.WIDTH - taken, 20)) or [""]
        found += [[*row[:-1], first], *([*[""] * (len(row) - 1), line] for line in more)]
    return found


def html_table(rows: Rows) -> str:
    """The table for a notebook."""
    tags = ("th", *["td"] * (len(rows) - 1))
    head, *body = (
        "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row) for tag, row in zip(tags, rows, strict=True)
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(f'<tr>{row}</tr>' for row in body)}</tbody></table>"
