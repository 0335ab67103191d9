"""Atomic writing of files, and checked reading of text, YAML, JSON and CSV.

Every reader raises InputError in one line that names the file and what is wrong with it.
"""

import codecs
import csv
import errno
import io
import json
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from sandbot_common.errors import InputError
from sandbot_common.terminal import counted


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary file next to ``path``; rename it onto ``path`` on success, remove it on any failure.

    A symbolic link is kept and its target replaced; a device or pipe (/dev/null) is written to directly.
    """
    if _is_special(path):
        yield path
        return
    path = Path(os.path.realpath(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    # mkstemp's mode 0600 would hide a result from colleagues.
    umask = os.umask(0)
    os.umask(umask)
    temporary.chmod(0o666 & ~umask)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _is_special(path: Path) -> bool:
    """Whether the path is a device or pipe, which a rename would replace."""
    return path.exists() and not path.is_file() and not path.is_dir()


def write_text(path: Path, text: str) -> None:
    """Write ``text`` (UTF-8) to ``path``, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def sync(path: Path) -> None:
    """Flush a file, or the names in a folder, to disk, so that they survive a power cut."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno != errno.EINVAL:  # this file system can't fsync a folder
            raise
    finally:
        os.close(handle)


def check_output(path: Path) -> Path:
    """``path``, if a file can be written there: checked before minutes of work, not after. Raises InputError."""
    if path.is_dir():
        raise InputError(f"{path}: can't be written: it is a folder, a file is needed")
    if _is_special(path):
        if not os.access(path, os.W_OK):
            raise InputError(f"{path}: can't be written: no permission")
        return path
    above = next(parent for parent in Path(os.path.realpath(path)).parents if parent.exists())
    if not above.is_dir():
        raise InputError(f"{path}: can't be written: {above} is not a folder")
    try:
        # By trial: the permissions of a read-only disk or of /proc don't show it.
        with tempfile.TemporaryFile(dir=above):
            return path
    except OSError as error:
        raise InputError(f"{path}: can't be written: no file can be made in {above} ({error.strerror})") from None


def base_name(path: Path) -> str:
    """The name of a folder, or of a file without its ending; a folder's may have dots (phi0.6000_w04.000_r01)."""
    there = Path(os.path.abspath(path))  # ``.`` has no name; a link keeps its own
    return there.stem if there.is_file() else there.name


def same_file(one: Path, other: Path) -> bool:
    """Whether two paths are the same file, existing or still to be written; a terminal or /dev/null is no file."""
    if one.exists() and other.exists():
        return one.is_file() and one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError while writing ``path`` into an InputError."""
    try:
        yield
    except (FileExistsError, NotADirectoryError) as error:
        raise InputError(f"{path}: can't be written: {_in_the_way(path) or error.strerror}") from None
    except OSError as error:
        raise InputError(f"{path}: can't be written: {error.strerror}") from None


def in_the_way(path: Path) -> Path | None:
    """The file that stands where ``path`` or a folder above it is needed; None if there is none."""
    return next((each for each in (path, *path.parents) if each.is_file()), None)


def _in_the_way(path: Path) -> str:
    blocking = in_the_way(path)
    return f"{blocking} is a file, a folder is needed" if blocking else ""


ARCHIVE = b"PK\x03\x04"
"""First bytes of a zip archive, and so of a workbook."""


def read_text(path: Path, needed: str = "a text file", remedy: str = "", notes: list[str] | None = None) -> str:
    """The UTF-8 text of a file, without a byte order mark; ``remedy`` ends the error line for a missing file.

    With ``notes``, other text is read as Windows-1252, and that is noted there.
    """
    try:
        return _decoded(path.read_bytes(), notes).replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{remedy}") from None
    except NotADirectoryError as error:
        raise InputError(f"{path}: {_in_the_way(path) or error.strerror}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, {needed} is needed") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file (UTF-8); {_instead(error, needed)}") from None


def _instead(error: UnicodeDecodeError, needed: str) -> str:
    """What to do about a file that is not text."""
    if error.object.startswith(ARCHIVE):
        return f"{needed} is needed; of a spreadsheet (.xlsx, .ods) save the sheet as CSV"
    # Text in an older encoding has a few letters beyond ASCII, and no zero bytes.
    place = error.object.count(b"\n", 0, error.start) + 1
    return f"{needed} is needed" if b"\0" in error.object else f"line {place} is not: save it as UTF-8 (CSV UTF-8)"


_CONTROL = re.compile(r"[^\t\n\r -~\xa0-\U0010ffff]")
"""Characters that no text has, once it is decoded by the right encoding."""


def _decoded(content: bytes, notes: list[str] | None = None) -> str:
    """Decode UTF-8, or UTF-16 with a byte order mark if it has an ASCII letter: nearly any bytes are valid UTF-16."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16")
        if any(letter.isascii() and letter.isalpha() for letter in text):
            return text
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        with suppress(UnicodeDecodeError):
            text = content.decode("cp1252")
            if notes is not None and not _CONTROL.search(text):
                notes.append("not UTF-8, read as Windows-1252: check letters beyond ASCII in names")
                return text
        raise


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Uses libyaml where available, which is ten times as fast as the Python loader. A duplicate key is an error, as
    the YAML standard says; PyYAML silently takes the last.
    """

    def flatten_mapping(self, node: Any) -> None:
        # Checked once, before `<<` merges in keys that the mapping's own may override.
        if not hasattr(node, "checked"):
            node.checked = True
            _refuse_duplicates(key for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        super().flatten_mapping(node)


def _refuse_duplicates(keys: Iterable[yaml.ScalarNode]) -> None:
    seen: set[tuple[str, str]] = set()
    for key in keys:
        if (key.tag, key.value) in seen:
            raise yaml.YAMLError(f"line {key.start_mark.line + 1}: key {key.value!r} is there twice")
        seen.add((key.tag, key.value))


def load_yaml(text: str) -> Any:
    """The content of a YAML text."""
    return yaml.load(text, Loader=_Loader)


@lru_cache(maxsize=16)
def shared_yaml(text: str) -> Any:
    """A cached ``load_yaml`` for a text that many bags carry; do not modify the result."""
    return load_yaml(text)


def dump_yaml(content: Any) -> str:
    """YAML text in the order of the mapping's keys, by libyaml where available."""
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(content, Dumper=dumper, sort_keys=False, allow_unicode=True))


def parse_yaml(text: str, where: str, load: Callable[[str], Any] = load_yaml) -> Any:
    """The content of a YAML text; ``where`` opens the error."""
    try:
        return load(text)
    except yaml.YAMLError as error:
        raise InputError(f"{where}: not YAML: {_yaml_trouble(error, text)}") from None
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        # Raised by PyYAML if a scalar does not match its tag or form: month 13, an empty !!int.
        raise InputError(f"{where}: not YAML: {type(error).__name__}: {' '.join(str(error).split())}") from None


def _yaml_trouble(error: yaml.YAMLError, text: str) -> str:
    """What PyYAML says, opened by the line and not by its own name for the text."""
    if not (isinstance(error, yaml.MarkedYAMLError) and (mark := error.problem_mark)):
        return " ".join(str(error).split())
    is_tab = text[mark.index : mark.index + 1] == "\t"
    problem = "a tab; indent by spaces" if is_tab else ": ".join(filter(None, (error.context, error.problem)))
    return f"line {mark.line + 1}, column {mark.column + 1}: {' '.join(problem.split())}"


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file."""
    content = parse_yaml(read_text(path, "a YAML file"), str(path))
    if not isinstance(content, dict):
        empty = "is empty; " if content is None else ""
        raise InputError(f"{path}: {empty}lines 'key: value' are needed")
    return content


def parse_json(text: str, where: str, remedy: str = "") -> Any:
    """The content of a JSON text; ``where`` opens the error, ``remedy`` ends it."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{where}: not JSON: line {error.lineno}: {error.msg}{remedy}") from None
    except (ValueError, RecursionError) as error:  # the latter: nested too deep
        raise InputError(f"{where}: not JSON: {error}{remedy}") from None


def read_json(path: Path, remedy: str = "") -> Any:
    """The content of a JSON file; ``remedy`` ends the error line where it is missing or not JSON."""
    return parse_json(read_text(path, "a JSON file", remedy), str(path), remedy)


def write_json(path: Path, content: object) -> None:
    """Write JSON to ``path``, whole or not at all. Raises InputError if it can't be written."""
    with writing(path):
        write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def append_line(path: Path, content: object) -> None:
    """Append ``content`` as one line of JSON. Raises InputError if it can't be written."""
    # A lone surrogate, which JSON may hold but UTF-8 may not, is written as its JSON escape.
    with writing(path), path.open("a", encoding="utf-8", errors="backslashreplace") as file:
        file.write(json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n")


def read_csv(
    path: Path,
    needed: str = "a CSV file",
    matters: Callable[[str], bool] = bool,
    notes: list[str] | None = None,
) -> tuple[list[str], Iterator[tuple[int, dict[str, str]]]]:
    """Column names of a CSV file, and its rows: (number in the file, text by column), stripped, without empty rows.

    The separator may also be a tab, a semicolon, what a first line such as ``sep=;`` names, or spaces if nothing else
    fits; with these, numbers may have a decimal comma. A title or comment lines (#) may come first; the last comment is
    the header if no other follows. A repeated header, as in concatenated files, is skipped. Columns that ``matters``
    selects must be unique, and lines above the first that has one are titles. With ``notes``, text that is not UTF-8 is
    read as Windows-1252, and that is noted there.
    """
    text = read_text(path, needed, notes=notes)
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
    rows = [(at, cells) for at, cells in enumerate(lines[first:], start=first + 1) if any(cells) and cells != header]
    # R writes row numbers without a column name.
    if rows and [cells[: -len(header)] for _, cells in rows] == [[str(at + 1)] for at in range(len(rows))]:
        header = ["", *header]
    return _Table(separator, header, rows)


def _header(lines: list[list[str]], matters: Callable[[str], bool]) -> tuple[list[str], int]:
    """The header, and the index of the first line below it. Comment lines (#) and single cells above a wider table
    precede the header, and so does a line without a cell that ``matters`` if one with such cells follows soon; but if
    numbers follow directly, the last comment with as many cells is it, as numpy writes it.
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
