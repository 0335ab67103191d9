"""Tables of text: comma-, tab-, semicolon- and space-separated, with decimal points or commas, below titles."""

import csv
import io
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sandbot_common.errors import InputError
from sandbot_common.files import read_text
from sandbot_common.terminal import counted


def read_csv(
    path: Path, needed: str = "a CSV file", matters: Callable[[str], bool] = bool, notes: list[str] | None = None
) -> tuple[list[str], Iterator[tuple[int, dict[str, str]]]]:
    """Column names of a CSV file, and its rows: (number in the file, text by column), stripped, without empty rows.

    The separator may also be a tab, a semicolon, what a first line such as ``sep=;`` names, or spaces if nothing else
    fits; with these, numbers may have a decimal comma. A title or comment lines (#) may come first; the last comment is
    the header if no other follows. Comments between rows are skipped, and so is a repeated header, as in concatenated
    files. Columns that ``matters`` selects must be unique, and lines above the first that has one are titles. With
    ``notes``, text that is not UTF-8 is read as Windows-1252, and that is noted there. Raises InputError.
    """
    text = read_text(path, needed, notes=notes)
    if "\0" in text:
        raise InputError(f"{path}: has NUL bytes, as UTF-16 without a byte order mark: save it as UTF-8 (CSV UTF-8)")
    if text.lstrip().startswith(("[{", "{", "[[")):
        raise InputError(f"{path}: is JSON, {needed} is needed")
    try:
        table = _table(text, matters)
    except csv.Error as error:
        raise InputError(f"{path}: not a CSV: {error}") from None
    header = [" ".join(name.split()) for name in table.header]
    if repeated := [name for index, name in enumerate(header) if matters(name) and name in header[:index]]:
        raise InputError(f"{path}: row 1: column {repeated[0]} is there twice")
    rows = table.rows if table.separator == "," else _with_points(path, header, table.rows)
    return header, _csv_rows(path, header, rows)


_SEP_LINE = re.compile(r""""?sep=([^\w"'.+-])\1*"?(?=\n|$)""", re.IGNORECASE)
NUMBER = re.compile(r"[+\-\N{MINUS SIGN}]?(\d+\.?|\d*[.,]\d+)(e[+-]?\d+)?", re.IGNORECASE)
"""A number in a cell, with a point or a comma."""
_NUMBER_OR_NONE = re.compile(rf"({NUMBER.pattern}|nan)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+\-\N{MINUS SIGN}]?[1-9]\d{0,2}[.,]\d{3}")
_TITLES = 10
"""A header is sought in so many lines."""
_Rows = list[tuple[int, list[str]]]


@dataclass(frozen=True)
class _Table:
    """A text split by one separator: its header, and the non-empty rows below with their numbers."""

    separator: str
    header: list[str]
    rows: _Rows

    @property
    def fit(self) -> tuple[bool, bool, int, int]:
        """The larger, the likelier this is the separator: rows as long as the header, a header of names (no numbers,
        even between other separators, no split quotes), few lines above it, many columns.
        """
        width = len(self.header)
        even = width > 1 and {len(cells) for _, cells in self.rows} == {width}
        first = self.rows[0][0] if self.rows else 0
        parts = (part for cell in self.header for part in (cell, *re.split("[,;\t]", cell)))
        names = not any(NUMBER.fullmatch(part) or '"' in part for part in parts)
        return even, names, -first, width

    @property
    def is_consistent(self) -> bool:
        """Whether its rows are as long as the header, and the header has names."""
        even, names, *_ = self.fit
        return even and names


def _table(text: str, matters: Callable[[str], bool]) -> _Table:
    """The text split by the separator that its first line names, or that fits best. Raises csv.Error if none does."""
    if named := _SEP_LINE.match(text):
        # The line's newline stays, so that the rows keep their numbers.
        return _split(text[named.end() :], named[1], matters)
    found, errors = [], []
    for separator in [sign for sign in ",\t;" if sign in text] or [","]:
        try:
            found.append(_split(text, separator, matters))
        except csv.Error as error:
            errors.append(error)
    if not any(table.is_consistent for table in found):
        with suppress(csv.Error):
            found += filter(lambda table: table.is_consistent, [_split(_single_spaced(text), " ", matters)])
    if not found:
        raise errors[0]
    return max(found, key=lambda table: table.fit)


def _single_spaced(text: str) -> str:
    """The text with one space between words, and none after the # of a comment, where numpy puts one."""
    lines = (" ".join(line.split()) for line in text.split("\n"))
    return "\n".join(re.sub("^#+ ", "#", line) for line in lines)


def _split(text: str, separator: str, matters: Callable[[str], bool]) -> _Table:
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True, skipinitialspace=True)
    # A byte order mark may occur inside concatenated files.
    lines = [[cell.strip().strip("\ufeff").strip() for cell in line] for line in reader]
    header, first = _header(lines, matters)
    rows = [
        (at, cells)
        for at, cells in enumerate(lines[first:], start=first + 1)
        if any(cells) and cells != header and not (_comment(cells) and not any(cells[1:]))
    ]
    # R writes row numbers without a column name.
    if rows and [cells[: -len(header)] for _, cells in rows] == [[str(at + 1)] for at in range(len(rows))]:
        header = ["", *header]
    return _Table(separator, header, rows)


def _header(lines: list[list[str]], matters: Callable[[str], bool]) -> tuple[list[str], int]:
    """The header, and the index of the first line below it.

    Above it may stand comments (#), single cells of a wider table, and lines without a cell that ``matters`` if one
    with such cells follows soon. If numbers come first, the header is the last comment with as many cells, as numpy
    writes it.
    """
    wide = any(sum(map(bool, line)) > 1 for line in lines if not _comment(line))
    for number, line in enumerate(lines):
        if not any(line) or _comment(line) or (wide and sum(map(bool, line)) < 2):
            continue
        if any(map(NUMBER.fullmatch, line)):
            for names in map(_comment, reversed(lines[:number])):
                if len(names) == len(line) and not any(map(NUMBER.fullmatch, names)):
                    return names, number
        soon = range(number, min(number + _TITLES, len(lines)))
        at = next((each for each in soon if any(map(matters, lines[each]))), number)
        return lines[at], at + 1
    return [], len(lines)


def number_in(cell: str) -> float:
    """The number in a cell, with a point. Raises ValueError, also for 1_0, which only Python reads as a number."""
    if "_" in cell:
        raise ValueError(cell)
    return float(cell.replace("\N{MINUS SIGN}", "-"))


def _comment(line: list[str]) -> list[str]:
    """The cells of a comment line without its #; empty for any other line."""
    return [line[0].lstrip("# \t"), *line[1:]] if line and line[0].startswith("#") else []


def _with_points(path: Path, header: list[str], rows: _Rows) -> _Rows:
    """The rows with decimal points instead of decimal commas. Columns with words in them are ignored.

    Raises InputError if it is unclear which sign is decimal: if numbers have both commas and points, or if the only
    sign appears exclusively where it may separate thousands.
    """
    words = {place for _, cells in rows for place, cell in enumerate(cells) if not _NUMBER_OR_NONE.fullmatch(cell)}
    places: dict[str, str] = {}
    decimals = False
    for number, cells in rows:
        for place, (name, cell) in enumerate(zip(header, cells, strict=False)):
            for sign in {",", "."}.intersection(cell) if place not in words else ():
                places.setdefault(sign, f"row {number}, column {name}: {cell!r}")
                decimals |= not _THOUSANDS.fullmatch(cell)
    if len(places) > 1:
        raise InputError(
            f"{path}: {places[',']} has a comma, but {places['.']} has a point: write the decimals of all numbers with "
            "the one or all with the other, and thousands with neither"
        )
    if places and not decimals:
        raise InputError(
            f"{path}: {', '.join(places.values())} may be a decimal number or thousands, and no other number tells: "
            "write thousands without a sign, or decimals of another length"
        )
    return [
        (number, [cell.replace(",", ".") if NUMBER.fullmatch(cell) else cell for cell in cells])
        for number, cells in rows
    ]


def _csv_rows(path: Path, header: list[str], rows: _Rows) -> Iterator[tuple[int, dict[str, str]]]:
    for number, cells in rows:
        if len(cells) != len(header):
            raise InputError(f"{path}: row {number}: {counted(len(cells), 'value')} for {len(header)} columns")
        yield number, dict(zip(header, cells, strict=True))
