"""The header of a CSV of trials: which column of the table each name means, in which unit."""

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from sandbot_common import separated
from sandbot_common.errors import InputError
from sandbot_common.suggest import near
from sandbot_record.trials.table import COLUMNS, REQUIRED

_BATCH_SYNONYMS = ("day", "preparation")
_MARKS = frozenset({"exclude", "excluded", "outlier", "valid", "use", "used", "ok", "good", "bad", "quality", "flag"})
"""Common names of columns that mark trials to exclude, in lower case."""
_QUANTITIES = {short: name for name, column in COLUMNS.items() for short in column.names}
"""Columns by their names without units."""
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


def with_unit_row(
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


def is_read(name: str) -> bool:
    """Whether a column of this name is one of the table's."""
    return known_names([name])[0] in COLUMNS


def known_names(header: Sequence[str]) -> list[str]:
    """The header with synonyms of ``batch`` and names with units replaced by the table's names, unless the table's own
    name is also there."""
    written = [_name(name) for name in header]
    synonym = next((name for name in _BATCH_SYNONYMS if name in written), None) if "batch" not in written else None
    known = [
        "batch" if own == synonym else unit_in_header(given)[0] for given, own in zip(header, written, strict=True)
    ]
    return [
        meant if meant in COLUMNS and (meant == own or meant not in written) else given
        for given, own, meant in zip(header, written, known, strict=True)
    ]


def unit_in_header(given: str) -> tuple[str, float]:
    """The table's name of a column such as ``omega [Hz]`` or ``speed_cm_s``, and the factor to its unit; other names
    are unchanged."""
    if (written := _name(given)) in COLUMNS:
        return written, 1.0
    name, unit = _with_unit(given)
    factor = _factors(name).get(unit)
    return (given, 1.0) if factor is None else (name, factor)


def check_header(where: str, header: Sequence[str], given: Sequence[str]) -> None:
    """Raise InputError if a required column is missing or two columns mean the same."""
    for name in REQUIRED:
        if name not in header:
            raise InputError(f"{where}: row 1: column {name} is missing{_hint(name, header)}")
    for name, count in Counter(header).items():
        if count > 1 and name in COLUMNS:
            both = " and ".join(repr(own) for own, meant in zip(given, header, strict=True) if meant == name)
            raise InputError(f"{where}: row 1: columns {both} are both {name}; leave one out")


def foreign(given: Sequence[str]) -> list[str]:
    """Columns that the table has no place for."""
    return [column for column in known_names(given) if column and column not in COLUMNS]


def unread(given: Sequence[str]) -> tuple[str, ...]:
    """Notes on the columns that are not read, with a suggestion where the intended column is recognisable."""
    header = known_names(given)
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


def _fits_unit_row(name: str, cell: str) -> bool:
    """Whether a cell is empty or the unit of its column, not a value; the right unit if the name already has one."""
    if not cell or not (factors := _factors(name)):
        return not separated.NUMBER.fullmatch(cell)
    return cell in factors and (_name(name) in _QUANTITIES or factors[cell] == 1.0)


def _factors(name: str) -> Mapping[str, float]:
    """Conversion factors of the units a column may have; empty if it has none."""
    column = COLUMNS.get(_QUANTITIES.get(_name(name), name))
    return column.factors if column else {}


def _with_unit(given: str) -> tuple[str, str]:
    """The table's name of a quantity whose column name has a unit, in brackets or at its end, and the unit; else empty.

    A volume fraction and a number of trials need no unit.
    """
    written = _name(given)
    if "1" in _factors(written) and written in _QUANTITIES:
        return _QUANTITIES[written], "1"
    if found := re.fullmatch(r"(.+?)[ _]*[\[(](.+)[\])]", given):
        return _QUANTITIES.get(_name(found[1]), ""), _unit(found[2])
    # Any other ending is not a unit but part of another name.
    ends = {name: _unit(written[len(name) + 1 :]) for name in _QUANTITIES if written.startswith(f"{name}_")}
    known = [(_QUANTITIES[name], unit) for name, unit in ends.items() if unit in _factors(name)]
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


def _hint(name: str, header: Sequence[str]) -> str:
    """A suggestion which column was meant, or a list of those there are."""
    for other in header:
        if _QUANTITIES.get(_name(other)) == name:
            return f"; {other} needs its unit, {other} [{'], ['.join(_factors(name))}]"
    if any(map(separated.NUMBER.fullmatch, header)):
        return "; there are numbers in that row: names of the columns are needed on top, and below one row per trial"
    kinds = [other for other in header if _name(other).startswith(f"{name}_") and other not in COLUMNS]
    if name == "phi" and len(kinds) > 1:
        return f"; of {' and '.join(map(repr, kinds))} call the one that was measured phi"
    # A known quantity with a unit is not misspelt: its unit is unknown.
    if foreign := next((other for other in header if _with_unit(other)[0] == name), ""):
        if _with_unit(foreign)[1] in ("1/s", "/s"):
            return f"; {foreign!r} may be in rad/s or in Hz: write which"
        return f"; {foreign!r} has a unit that is not known; {', '.join(_factors(name))} are"
    if len(header) == 1 and " " in header[0]:
        return "; columns are separated by commas, tabs or semicolons, or by spaces where no name or value has any"
    strange = [other for other in header if other not in COLUMNS and not set(other) & set("[(")]
    close = near(name, strange)
    return f"; is {close!r} meant?" if close else f"; there are: {', '.join(filter(None, header))}"
