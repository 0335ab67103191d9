"""The header of a CSV of trials: which column of the table each name means, in which unit."""

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import takewhile

from sandbot_common import delimited_text
from sandbot_common.errors import InputError
from sandbot_common.suggest import near
from sandbot_record.trials.columns import SPEED
from sandbot_record.trials.table import COLUMNS, REQUIRED

_BATCH_SYNONYMS = ("day", "preparation")
_MARKS = frozenset({"exclude", "excluded", "outlier", "valid", "use", "used", "ok", "good", "bad", "quality", "flag"})
"""Common names of columns that mark trials to exclude, in lower case."""
_DATES = frozenset({"date", "datetime", "date_time", "timestamp", "start_time", "datum"})
_TIMES = frozenset({"time", "hour", "clock", "uhrzeit"})
"""Common names of columns that tell when a trial was run; of the latter, beside a date."""
_ERROR_BARS = frozenset({"sd", "std", "se", "sem", "error", "err", "±", "+-", "+/-", "uncertainty", "upper", "lower"})
"""Common names of columns beside the speed that hold its error bar; any other has a unit of speed."""
_STEPS = frozenset({"s", "s/r", "step", "step_length", "s_m", "s_cm", "s_mm", "step_m", "step_cm", "step_length_m"})
"""Common names of the length of a step, as the paper plots it in Fig. 3d."""
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
    "–": "-",
    "—": "-",
}
"""Units as written at the end of a column name."""
_SEPARATED_UNIT = re.compile(
    r"(?P<name>.+?)(?:[ _]*[\[(]|[ _]*/ *\(?|[,;] *| in )(?P<unit>[^\[\](]+?)[\])]?", re.IGNORECASE
)
"""A name and its unit: ω [rad/s], ω (rad/s), ω/(rad/s) as ISO 80000 writes it, f/Hz, "ω, rad/s", "ω in rad/s"."""


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
    bars, dates = _error_bars(header), _dates(header) if "started" in missing else []
    found, others = [], []
    if bars:
        found.append(
            f"{_not_read(bars)}: an error bar of the speed is called speed_sd (standard deviation) or speed_sem "
            "(standard error; 95 % are ± 1.96 of it), with its unit"
        )
    if dates:
        found.append(f"{_not_read(dates)}: when a trial was run is given in one column, started, as 2026-05-04 08:10")
    for column in [name for name in foreign(given) if name not in (*bars, *dates)]:
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
        found.append(f"{_not_read(marks)}: to exclude a trial, give it a status other than ok")
    return (*found, *([f"columns that are not read: {', '.join(others)}"] if others else []))


def _not_read(names: Sequence[str]) -> str:
    return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} not read"


def _error_bars(header: Sequence[str]) -> list[str]:
    """Unknown columns that follow the speed directly and are, by unit or name, its error bars; none if it has any."""
    if "speed_m_s" not in header or {"speed_sd_m_s", "speed_sem_m_s"} & set(header):
        return []
    after = header[header.index("speed_m_s") + 1 :]
    return list(takewhile(_is_error_bar, after))


def _is_error_bar(given: str) -> bool:
    """Whether a column beside the speed may be its error bar; another column of the speed is none."""
    return not is_read(given) and (_name(given) in _ERROR_BARS or _is_speed(given))


def _is_speed(given: str) -> bool:
    """Whether a column's name ends in a unit of speed."""
    found = _SEPARATED_UNIT.fullmatch(given)
    endings = [ending for ending, unit in _UNITS.items() if unit in SPEED.factors]
    return bool(found and _unit(found["unit"]) in SPEED.factors) or _name(given).endswith(tuple(endings))


def _dates(header: Sequence[str]) -> list[str]:
    """Columns of dates, and of times if there are any."""
    dates = [name for name in header if _name(name) in _DATES]
    return [name for name in header if name in dates or (dates and _name(name) in _TIMES)]


def _fits_unit_row(name: str, cell: str) -> bool:
    """Whether a cell is empty or the unit of its column, not a value; the right unit if the name already has one."""
    if not cell or not (factors := _factors(name)):
        return not delimited_text.NUMBER.fullmatch(cell)
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
    found = _SEPARATED_UNIT.fullmatch(given)
    if found and _name(found["name"]) in _QUANTITIES:
        return _QUANTITIES[_name(found["name"])], _unit(found["unit"])
    # Any other ending is not a unit but part of another name.
    ends = {name: _unit(written[len(name) + 1 :]) for name in _QUANTITIES if written.startswith(f"{name}_")}
    known = [(_QUANTITIES[name], unit) for name, unit in ends.items() if unit in _factors(name)]
    return next(((meant, unit) for meant, unit in known if unit not in "1-"), ("", ""))


def _unit(text: str) -> str:
    """A unit as spelt in the table of factors: m s-1, m·s⁻¹ and m/sec become m/s."""
    plain = re.sub("[ _]per[ _]", "/", _plain(text))
    plain = plain.replace("\N{MINUS SIGN}", "-").replace("^", "").replace("/sec", "/s")
    return _UNITS.get(plain, re.sub(r"[ .·⋅*]?s-1$", "/s", plain))


def _plain(text: str) -> str:
    """In lower case and with equivalent code points unified, as µ may be a micro sign and ϕ a symbol."""
    return unicodedata.normalize("NFKC", text).strip().lower()


def _name(text: str) -> str:
    """A column name in lower case with underscores."""
    return _plain(text).replace(" ", "_")


def _is_wide(name: str, header: Sequence[str]) -> bool:
    """Whether several columns are numbered ones of a quantity, or hold its values: v1, v2; phi=0.58, phi=0.60."""
    numbered = [re.fullmatch(r"(.+?)[ _=#]*\d[\d.,]*", _name(re.sub(r"[\[(].*", "", other))) for other in header]
    return sum(bool(found and _QUANTITIES.get(found[1]) == name) for found in numbered) > 1


def _hint(name: str, header: Sequence[str]) -> str:
    """A suggestion which column was meant, or a list of those there are."""
    for other in header:
        if _QUANTITIES.get(_name(other)) == name:
            return f"; {other} needs its unit, {other} [{'], ['.join(_factors(name))}]"
    if any(map(delimited_text.NUMBER.fullmatch, header)):
        return "; there are numbers in that row: names of the columns are needed on top, and below one row per trial"
    kinds = [other for other in header if _name(other).startswith(f"{name}_") and other not in COLUMNS]
    if name == "phi" and len(kinds) > 1:
        return f"; of {' and '.join(map(repr, kinds))} call the one that was measured phi"
    if _is_wide(name, header):
        return "; one row per trial is needed: of several columns of one quantity make several rows"
    # A known quantity with a unit is not misspelt: its unit is unknown.
    if foreign := next((other for other in header if _with_unit(other)[0] == name), ""):
        if _with_unit(foreign)[1] in ("1/s", "/s"):
            return f"; {foreign!r} may be in rad/s or in Hz: write which"
        return f"; {foreign!r} has a unit that is not known; {', '.join(_factors(name))} are"
    if len(header) == 1 and (between := re.search(r"[|:]", header[0])) and header[0].count(between[0]) > 1:
        return f"; columns are separated by commas, semicolons, tabs or spaces, not by {between[0]!r}"
    if len(header) == 1 and " " in header[0]:
        return "; columns are separated by commas, tabs or semicolons, or by spaces where no name or value has any"
    if name == "speed_m_s" and (step := next((other for other in header if _name(other) in _STEPS), "")):
        return f"; of a step s, as in {step!r}, mean speed is sω/π"
    strange = [other for other in header if other not in COLUMNS and not set(other) & set("[(")]
    close = near(name, strange)
    return f"; is {close!r} meant?" if close else f"; there are: {', '.join(filter(None, header))}"
