"""A trials table as CSV: this project's own, or any table with the three required columns."""

import contextlib
import csv
import io
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sandbot_common import files
from sandbot_common.errors import InputError
from sandbot_common.suggest import near
from sandbot_record.trials.table import (
    COLUMNS,
    OF_MEANS,
    OK,
    ORDER_AND_TIME,
    REQUIRED,
    TEXTS,
    Row,
    Trials,
    check_ids,
    from_rows,
)

_BOUNDS = {
    "phi": (0.0, 1.0, "a volume fraction between 0 and 1, both excluded"),
    "omega_rad_s": (0.0, 1000.0, "a leg frequency above 0 rad/s"),
    "speed_m_s": (-10.0, 10.0, "a speed in m/s"),
    "peak_speed_m_s": (-10.0, 10.0, "a speed in m/s"),
    "lift_m": (-1.0, 1.0, "a length in m"),
    "first_step_m": (-10.0, 10.0, "a length in m"),
    "n_trials": (0.0, 1e6, "a whole number of trials above 0"),
}
NAMELESS = re.compile(r"row\d+")
"""Generated ids of trials in tables without a trial_id."""
BATCH_SYNONYMS = ("day", "preparation")
PRESETS = ("SGCS", "HGCS", "UNIFORM")
_NOT_MEASURED = frozenset(
    {"", "-", "--", "–", "—", ".", "?", "n/a", "na", "<na>", "nan", "null", "none", "missing", "nd", "n.d.", "k.a."}
    | {"#n/a", "#na", "#nv", "#n/v", "#div/0!", "#value!", "#wert!"}
)
"""Common spellings of "not measured", in lower case."""
_SUMMARIES = frozenset({"mean", "average", "median", "sd", "std", "stdev", "sem", "sum", "total", "min", "max"})
"""Common names of a spreadsheet's summary rows, in lower case."""
_MARKS = frozenset({"exclude", "excluded", "outlier", "valid", "use", "used", "ok", "good", "bad", "quality", "flag"})
"""Common names of columns that mark trials to exclude, in lower case."""
_NOT_NEGATIVE = ("phi_sd", "speed_sd_m_s", "speed_sem_m_s")
_QUANTITIES = {
    **dict.fromkeys(("phi", "φ", "volume_fraction", "packing_fraction", "solid_fraction"), "phi"),
    **dict.fromkeys(("omega", "ω", "frequency", "freq", "f", "leg_frequency", "limb_frequency"), "omega_rad_s"),
    **dict.fromkeys(("speed", "mean_speed", "average_speed", "forward_speed", "velocity", "v"), "speed_m_s"),
    **dict.fromkeys(("lift", "body_lift", "δz", "∆z"), "lift_m"),
    "peak_speed": "peak_speed_m_s",
    "first_step": "first_step_m",
    "speed_sd": "speed_sd_m_s",
    **dict.fromkeys(("speed_sem", "speed_se", "speed_stderr", "speed_standard_error"), "speed_sem_m_s"),
    **dict.fromkeys(("n", "replicates", "number_of_trials"), "n_trials"),
}
_SPEEDS = {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001}
_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "μm": 1e-6, "um": 1e-6}
_FACTORS = {
    "phi": {"1": 1.0, "-": 1.0, "%": 0.01},
    "omega_rad_s": {"rad/s": 1.0, "hz": 2 * math.pi, "rpm": math.pi / 30, "deg/s": math.pi / 180},
    **dict.fromkeys(("speed_m_s", "speed_sd_m_s", "speed_sem_m_s", "peak_speed_m_s"), _SPEEDS),
    **dict.fromkeys(("lift_m", "first_step_m"), _LENGTHS),
    "n_trials": {"1": 1.0, "-": 1.0},
}
"""Conversion factors to the table's units, by the unit in brackets after a quantity."""
_UNITS = {
    "m_s": "m/s",
    "cm_s": "cm/s",
    "mm_s": "mm/s",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "°/s": "deg/s",
    "percent": "%",
}
"""Units as written at the end of a column name."""


def read_csv(path: Path) -> Trials:
    """A trials table from a CSV file; only phi, omega_rad_s and speed_m_s are required. Raises InputError."""
    notes: list[str] = []
    header, lines = _with_unit_row(*files.read_csv(path, "a trials CSV, a bag or a campaign folder", _is_read, notes))
    told = (*(f"{path}: {note}" for note in notes), *unread(header))
    return replace(from_rows(rows_of(header, lines, str(path))), unread=told)


def write_csv(trials: Trials, path: Path) -> None:
    """Write the table atomically."""
    files.write_text(path, to_csv(trials))


def to_csv(trials: Trials) -> str:
    """The table as CSV text; values not measured are empty, numbers are exact when read back.

    Columns of order and time, and of means, are written only if they are not empty.
    """
    rows = trials.rows()
    cells = {name: [_cell(getattr(row, name)) for row in rows] for name in COLUMNS}
    names = [name for name in COLUMNS if name not in (*ORDER_AND_TIME, *OF_MEANS) or any(cells[name])]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(cells[name] for name in names), strict=True))
    return text.getvalue()


def rows_of(given: Sequence[str], lines: Iterable[tuple[int, Mapping[str, str]]], where: str) -> list[Row]:
    """The rows of a table given as (row number, cells by column). ``where`` is the prefix of every InputError."""
    header = _known_names(given)
    if not any(header):
        raise InputError(f"{where}: empty; a header with {', '.join(REQUIRED)} and one row per trial are needed")
    _check_header(where, header, given)
    rows, numbers = [], []
    for number, cells in lines:
        own = {name: _in_si(cells[original], original) for name, original in zip(header, given, strict=True)}
        rows.append(_csv_row(f"{where}: row {number}", number, own))
        numbers.append(number)
    if not rows:
        raise InputError(f"{where}: no trials: nothing below the header")
    check_ids(rows, [f"{where}: row {number}, column trial_id" for number in numbers])
    return rows


def _with_unit_row(
    header: Sequence[str], lines: Iterable[tuple[int, dict[str, str]]]
) -> tuple[Sequence[str], Iterable[tuple[int, dict[str, str]]]]:
    """Header and lines, with the units of a second header row, if there is one, moved to the column names."""
    lines = list(lines)
    below = {name: _unit(cell.strip("[()]")) for name, cell in lines[0][1].items()} if lines else {}
    units = any(cell in _factors(name) for name, cell in below.items())
    if not units or not all(_fits_unit_row(name, cell) for name, cell in below.items()):
        return header, lines
    full = [f"{name} [{below[name]}]" if below[name] and _name(name) in _QUANTITIES else name for name in header]
    return full, [(at, {new: cells[old] for old, new in zip(header, full, strict=True)}) for at, cells in lines[1:]]


def _fits_unit_row(name: str, cell: str) -> bool:
    """Whether a cell is empty or the unit of its column, not a value; the right unit if the name already has one."""
    if not cell or not (factors := _factors(name)):
        return not files.NUMBER.fullmatch(cell)
    return cell in factors and (_name(name) in _QUANTITIES or factors[cell] == 1.0)


def _factors(name: str) -> dict[str, float]:
    """Conversion factors of the units a column may have; empty if it has none."""
    return _FACTORS.get(_QUANTITIES.get(_name(name), name), {})


def _is_read(name: str) -> bool:
    return _known_names([name])[0] in COLUMNS


def _known_names(header: Sequence[str]) -> list[str]:
    """The header with synonyms of ``batch`` and names with units replaced by the table's names, unless the table's own
    name is also there."""
    written = [_name(name) for name in header]
    synonym = next((name for name in BATCH_SYNONYMS if name in written), None) if "batch" not in written else None
    known = [
        "batch" if own == synonym else _unit_in_header(given)[0] for given, own in zip(header, written, strict=True)
    ]
    return [
        meant if meant in COLUMNS and (meant == own or meant not in written) else given
        for given, own, meant in zip(header, written, known, strict=True)
    ]


def _unit_in_header(given: str) -> tuple[str, float]:
    """The table's name of a column such as ``omega [Hz]`` or ``speed_cm_s``, and the factor to its unit; other names
    are unchanged."""
    if (written := _name(given)) in COLUMNS:
        return written, 1.0
    name, unit = _with_unit(given)
    factor = _FACTORS.get(name, {}).get(unit)
    return (given, 1.0) if factor is None else (name, factor)


def _with_unit(given: str) -> tuple[str, str]:
    """The table's name of a quantity whose column name has a unit, in brackets or at its end, and the unit; else empty.

    A volume fraction and a number of trials need no unit.
    """
    written = _name(given)
    if (meant := _QUANTITIES.get(written, "")) in ("phi", "n_trials"):
        return meant, "1"
    if found := re.fullmatch(r"(.+?)[ _]*[\[(](.+)[\])]", given):
        return _QUANTITIES.get(_name(found[1]), ""), _unit(found[2])
    # Any other ending is not a unit but part of another name.
    ends = {name: _unit(written[len(name) + 1 :]) for name in _QUANTITIES if written.startswith(f"{name}_")}
    known = [(_QUANTITIES[name], unit) for name, unit in ends.items() if unit in _FACTORS[_QUANTITIES[name]]]
    return next(((meant, unit) for meant, unit in known if unit not in "1-"), ("", ""))


def _unit(text: str) -> str:
    """A unit as spelt in the table of factors: m s-1, m·s⁻¹ and m/sec become m/s."""
    plain = _plain(text).replace("\N{MINUS SIGN}", "-").replace("^", "").replace("/sec", "/s")
    return _UNITS.get(plain, re.sub(r"[ .·⋅*]?s-1$", "/s", plain))


def _plain(text: str) -> str:
    """In lower case and with equivalent code points unified, as µ may be a micro sign and ϕ a symbol."""
    return unicodedata.normalize("NFKC", text).strip().lower()


def _name(text: str) -> str:
    """A column name in lower case with underscores."""
    return _plain(text).replace(" ", "_")


def _in_si(text: str, column: str) -> str:
    name, factor = _unit_in_header(column)
    if name in ("phi", "phi_sd") and text.endswith("%"):  # a spreadsheet's format of a cell
        text, factor = text.removesuffix("%").rstrip(), 0.01
    with contextlib.suppress(ValueError):
        return text if factor == 1.0 or not text else repr(files.number_in(text) * factor)
    return text


def _check_header(where: str, header: Sequence[str], given: Sequence[str]) -> None:
    for name in REQUIRED:
        if name not in header:
            raise InputError(f"{where}: row 1: column {name} is missing{_hint(name, header)}")
    for name, count in Counter(header).items():
        if count > 1 and name in COLUMNS:
            both = " and ".join(repr(own) for own, meant in zip(given, header, strict=True) if meant == name)
            raise InputError(f"{where}: row 1: columns {both} are both {name}; leave one out")


def foreign(given: Sequence[str]) -> list[str]:
    """Columns that the table has no place for."""
    return [column for column in _known_names(given) if column and column not in COLUMNS]


def unread(given: Sequence[str]) -> tuple[str, ...]:
    """Notes on the columns that are not read, with a suggestion where the intended column is recognisable."""
    header = _known_names(given)
    missing = [name for name in COLUMNS if name not in header]
    found, others = [], []
    for column in foreign(given):
        # If the quantity has its own column, this one is unrelated: f [N] is a force.
        meant = _with_unit(column)[0] or _QUANTITIES.get(_name(column), "")
        name = meant or near(column, missing)
        if name in missing:
            found.append(
                f"column {column} is not read{_hint(name, [column]) if meant else f', did you mean {name!r}?'}"
            )
        else:
            others.append(column)
    if marks := [column for column in others if _plain(column) in _MARKS]:
        found.append(f"{' and '.join(marks)} is not read: to exclude a trial, give it a status other than ok")
    return (*found, *([f"columns that are not read: {', '.join(others)}"] if others else []))


def _hint(name: str, header: Sequence[str]) -> str:
    """A suggestion which column was meant, or a list of those there are."""
    for other in header:
        if _QUANTITIES.get(_name(other)) == name:
            return f"; {other} needs its unit, {other} [{'], ['.join(_FACTORS[name])}]"
    if any(map(files.NUMBER.fullmatch, header)):
        return "; there are numbers in that row: names of the columns are needed on top, and below one row per trial"
    kinds = [other for other in header if _name(other).startswith(f"{name}_") and other not in COLUMNS]
    if name == "phi" and len(kinds) > 1:
        return f"; of {' and '.join(map(repr, kinds))} call the one that was measured phi"
    # A known quantity with a unit is not misspelt: its unit is unknown.
    if foreign := next((other for other in header if _with_unit(other)[0] == name), ""):
        if _with_unit(foreign)[1] in ("1/s", "/s"):
            return f"; {foreign!r} may be in rad/s or in Hz: write which"
        return f"; {foreign!r} has a unit that is not known; {', '.join(_FACTORS[name])} are"
    if len(header) == 1 and " " in header[0]:
        return "; columns are separated by commas, tabs or semicolons, or by spaces where no name or value has any"
    strange = [other for other in header if other not in COLUMNS and not set(other) & set("[(")]
    close = near(name, strange)
    return f"; is {close!r} meant?" if close else f"; there are: {', '.join(filter(None, header))}"


def _csv_row(where: str, number: int, cells: Mapping[str, str]) -> Row:
    status = cells.get("status", "") or OK
    status = OK if status.lower() == OK else status
    if status == OK and (summary := cells.get("trial_id", "")).lower() in _SUMMARIES:
        raise InputError(
            f"{where}, column trial_id: {summary!r} is a summary, not a trial; leave it out (or give it a status other "
            "than ok)"
        )
    values: dict[str, Any] = {"trial_id": f"row{number}", "gait": "", "status": status, "batch": "", "started": ""}
    for name in COLUMNS:
        text = cells.get(name, "")
        if name in TEXTS:
            text = "" if text.lower() in _NOT_MEASURED else text
            text = _CANONICAL[name](text) if name in _CANONICAL else text
            values[name] = values[name] if name == "status" else text or values[name]
        else:
            values[name] = _number(f"{where}, column {name}", name, text, required=name in REQUIRED and status == OK)
    return Row(**values)


def _gait(text: str) -> str:
    """A preset's name in upper case; other names unchanged."""
    return text.upper() if text.upper() in PRESETS else text


def _batch(text: str) -> str:
    """A numbered batch without decimals, as a spreadsheet may write 1 or 1.0."""
    return text.removesuffix(".0") if text.removesuffix(".0").isdecimal() else text


_CANONICAL = {"gait": _gait, "batch": _batch}
"""Functions that unify different spellings of the same value."""


def _number(where: str, name: str, text: str, *, required: bool) -> float:
    instead = "a value is needed here (or a status other than ok)" if required else "leave empty what was not measured"
    if text.lower() in _NOT_MEASURED:
        if required:
            raise InputError(f"{where}: {text or 'empty'}; {instead}")
        return math.nan
    try:
        value = files.number_in(text)
    except ValueError:
        instead = "write decimals with a point" if "," in text else instead
        raise InputError(f"{where}: {text!r} is not a number; {instead}") from None
    if not math.isfinite(value):
        raise InputError(f"{where}: {text} is not a finite number; {instead}")
    low, high, right = _BOUNDS.get(name, (-math.inf, math.inf, ""))
    if not low < value < high or (name == "n_trials" and value % 1):
        percent = "; divide percent by 100" if name == "phi" and 1 < value < 100 else ""
        raise InputError(f"{where}: {text} is out of range: {right} is needed{percent}")
    if name in _NOT_NEGATIVE and value < 0:
        raise InputError(f"{where}: {text} is negative: a standard deviation is needed")
    return value


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    if math.isnan(value):
        return ""
    # repr is the shortest text that reads back as the same number.
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
