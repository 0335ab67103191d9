"""A trials table as CSV: this project's own, or any table with the three required columns."""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sandbot_common import delimited_text, files
from sandbot_common.errors import InputError
from sandbot_record.trials.columns import Kind
from sandbot_record.trials.header import check_header, is_read, known_names, unit_in_header, unread, with_unit_row
from sandbot_record.trials.table import COLUMNS, CONDITION, OK, REQUIRED, Row, Trials, check_ids, from_rows

Cell = tuple[str, float]
"""A cell's text, and the factor to the unit of its column in the table."""
_EMPTY: Cell = "", 1.0
NAMELESS = re.compile(r"row\d+")
"""Generated ids of trials in tables without a trial_id."""
PRESETS = ("SGCS", "HGCS", "UNIFORM")
_NOT_MEASURED = frozenset(
    {"", "-", "--", "–", "—", "\N{MINUS SIGN}", "\N{NON-BREAKING HYPHEN}", ".", "?", "n/a", "n.a.", "na", "<na>"}
    | {"nan", "null", "none", "missing", "nd", "n.d.", "nm", "n.m.", "k.a.", "1.#qnan", "-1.#ind"}
    | {"#n/a", "#na", "#nv", "#n/v", "#div/0!", "#value!", "#wert!", "#ref!", "#bezug!", "#num!", "#zahl!"}
)
"""Common spellings of "not measured", in lower case."""
_NO_NUMBER = _NOT_MEASURED | {"x", "*"}
"""The same in columns of numbers."""
_SUMMARIES = frozenset({"mean", "average", "median", "sd", "std", "stdev", "sem", "sum", "total", "min", "max"})
"""Common names of a spreadsheet's summary rows, in lower case."""


def read_csv(path: Path) -> Trials:
    """A trials table from a CSV file; only phi, omega_rad_s and speed_m_s are required. Raises InputError."""
    notes: list[str] = []
    header, lines = with_unit_row(
        *delimited_text.read_csv(path, "a trials CSV, a bag or a campaign folder", is_read, notes)
    )
    told = (*(f"{path}: {note}" for note in notes), *unread(header))
    return replace(from_rows(rows_of(header, lines, str(path))), unread=told)


def write_csv(trials: Trials, path: Path) -> None:
    """Write the table atomically."""
    files.write_text(path, to_csv(trials))


def to_csv(trials: Trials) -> str:
    """The table as CSV text; values not measured are empty, numbers are exact when read back.

    Optional columns are written only if they are not empty.
    """
    rows = trials.rows()
    cells = {name: [_cell(getattr(row, name)) for row in rows] for name in COLUMNS}
    names = [name for name, column in COLUMNS.items() if any(cells[name]) or not column.optional]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(cells[name] for name in names), strict=True))
    return text.getvalue()


def rows_of(given: Sequence[str], lines: Iterable[tuple[int, Mapping[str, str]]], where: str) -> list[Row]:
    """The rows of a table given as (row number, cells by column). ``where`` is the prefix of every InputError."""
    header = known_names(given)
    if not any(header):
        raise InputError(f"{where}: empty; a header with {', '.join(REQUIRED)} and one row per trial are needed")
    check_header(where, header, given)
    rows, numbers = [], []
    for number, cells in lines:
        own = {name: _with_factor(cells[original], original) for name, original in zip(header, given, strict=True)}
        rows.append(_csv_row(f"{where}: row {number}", number, own))
        numbers.append(number)
    if not rows:
        raise InputError(f"{where}: no trials: nothing below the header")
    check_ids(rows, [f"{where}: row {number}, column trial_id" for number in numbers])
    return rows


def _with_factor(text: str, column: str) -> Cell:
    name, factor = unit_in_header(column)
    if name in ("phi", "phi_sd") and text.endswith("%"):  # a spreadsheet's format of a cell
        text, factor = text.removesuffix("%").rstrip(), 0.01
    return text, factor


def _csv_row(where: str, number: int, cells: Mapping[str, Cell]) -> Row:
    status = cells.get("status", _EMPTY)[0] or OK
    status = OK if status.lower() == OK else status
    if status == OK and (summary := cells.get("trial_id", _EMPTY)[0]).lower() in _SUMMARIES:
        raise InputError(
            f"{where}, column trial_id: {summary!r} is a summary, not a trial; leave it out (or give it a status other "
            "than ok)"
        )
    values: dict[str, Any] = {}
    for name, column in COLUMNS.items():
        cell = cells.get(name, _EMPTY)
        if column.kind is None:
            values[name] = _text(name, cell[0])
        else:
            needed = name in CONDITION and status == OK
            values[name] = _number(f"{where}, column {name}", column.kind, cell, required=needed)
    return Row(**values | {"status": status, "trial_id": values["trial_id"] or f"row{number}"})


def _text(name: str, written: str) -> str:
    return "" if written.lower() in _NOT_MEASURED else _CANONICAL.get(name, str)(written)


def _gait(text: str) -> str:
    """A preset's name in upper case; other names unchanged."""
    return text.upper() if text.upper() in PRESETS else text


def _batch(text: str) -> str:
    """A numbered batch without decimals, as a spreadsheet may write 1 or 1.0."""
    return text.removesuffix(".0") if text.removesuffix(".0").isdecimal() else text


_CANONICAL = {"gait": _gait, "batch": _batch}
"""Functions that unify different spellings of the same value."""


def _number(where: str, kind: Kind, cell: Cell, *, required: bool) -> float:
    text, factor = cell
    instead = "a value is needed here (or a status other than ok)" if required else "leave empty what was not measured"
    if text.lower() in _NO_NUMBER:
        if required:
            filled = "" if text else "; a cell merged over several rows has to be filled down"
            raise InputError(f"{where}: {text or 'empty'}; {instead}{filled}")
        return math.nan
    try:
        value = delimited_text.number_in(text) * factor
    except ValueError:
        instead = "write decimals with a point" if "," in text else instead
        raise InputError(f"{where}: {text!r} is not a number; {instead}") from None
    if not math.isfinite(value):
        raise InputError(f"{where}: {text} is not a finite number; {instead}")
    if not kind.admits(value):
        units = (name for unit, name in {"%": "percent", "cm/s": "cm/s"}.items() if unit in kind.factors)
        remedy = next(units, "") if factor == 1.0 else ""
        divided = f"; divide {remedy} by 100" if remedy and kind.admits(value / 100) else ""
        text += "" if factor == 1.0 else f" × {factor:.4g} = {value:.4g}"
        raise InputError(f"{where}: {text} is out of range: {kind.needed} is needed{divided}")
    return value


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    if math.isnan(value):
        return ""
    # repr is the shortest text that reads back as the same number.
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
