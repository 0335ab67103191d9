"""Files that are whole or not there, and text, YAML, JSON and CSV that are what they should be.

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


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside ``path``; rename it onto ``path`` on success, remove it on any failure.

    A link goes on leading to the file, which is replaced; what is no file (/dev/null, a pipe) is written into.
    """
    if _is_special(path):
        yield path
        return
    path = Path(os.path.realpath(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    # mkstemp's 0600 is for secrets; a result is for colleagues.
    umask = os.umask(0)
    os.umask(umask)
    temporary.chmod(0o666 & ~umask)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _is_special(path: Path) -> bool:
    """Whether there is something that takes what is written, and is no file: a rename would remove it."""
    return path.exists() and not path.is_file() and not path.is_dir()


def write_text(path: Path, text: str) -> None:
    """Write ``text`` (UTF-8) to ``path``, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def sync(path: Path) -> None:
    """Have a file, or the names in a folder, outlive a power cut."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno != errno.EINVAL:  # of a folder: this file system keeps names in a way of its own
            raise
    finally:
        os.close(handle)


def check_output(path: Path) -> Path:
    """``path``, if a file can be written there: told before minutes of work, not after. Raises InputError."""
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
        # Tried: of a disk that is read-only, or of /proc, no permission tells.
        with tempfile.TemporaryFile(dir=above):
            return path
    except OSError as error:
        raise InputError(f"{path}: can't be written: no file can be made in {above} ({error.strerror})") from None


def same_file(one: Path, other: Path) -> bool:
    """Whether two names are those of one file, there or still to be written; a terminal or /dev/null is no file."""
    if one.exists() and other.exists():
        return one.is_file() and one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """A disk that refuses ``path`` after all is bad input, too."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: can't be written: {error.strerror}") from None


ARCHIVE = b"PK\x03\x04"
"""How a zip archive begins, which a workbook is."""


def read_text(path: Path, needed: str = "a text file", remedy: str = "") -> str:
    """The UTF-8 text of a file, without a byte order mark; ``remedy`` ends the line about a file that is missing."""
    try:
        return _decoded(path.read_bytes()).replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{remedy}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, {needed} is needed") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file (UTF-8); {_instead(error, needed)}") from None


def _instead(error: UnicodeDecodeError, needed: str) -> str:
    """What to do about a file that is no text."""
    if error.object.startswith(ARCHIVE):
        return f"{needed} is needed; of a spreadsheet (.xlsx, .ods) save the sheet as CSV"
    # Text of an older encoding has letters beyond ASCII here and there, and no byte 0.
    place = error.object.count(b"\n", 0, error.start) + 1
    return f"{needed} is needed" if b"\0" in error.object else f"line {place} is not: save it as UTF-8 (CSV UTF-8)"


def _decoded(content: bytes) -> str:
    """UTF-8, or UTF-16 by its mark: nearly any bytes are UTF-16, so without a letter of ASCII they are no text here."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16")
        if any(letter.isascii() and letter.isalpha() for letter in text):
            return text
    return content.decode("utf-8-sig")


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """By libyaml where the wheel has it: ten times the speed of the Python loader. A key that is there twice is an
    error, as YAML has it; of the two PyYAML takes the last without a word.
    """

    def flatten_mapping(self, node: Any) -> None:
        # Before what `<<` merges comes in, which a mapping's own keys may override; and so only once.
        if not hasattr(node, "checked"):
            node.checked = True
            _refuse_twice(key for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        super().flatten_mapping(node)


def _refuse_twice(keys: Iterable[yaml.ScalarNode]) -> None:
    seen: set[tuple[str, str]] = set()
    for key in keys:
        if (key.tag, key.value) in seen:
            raise yaml.YAMLError(f"line {key.start_mark.line + 1}: key {key.value!r} is there twice")
        seen.add((key.tag, key.value))


def load_yaml(text: str) -> Any:
    """What a YAML text holds."""
    return yaml.load(text, Loader=_Loader)


@lru_cache(maxsize=16)
def shared_yaml(text: str) -> Any:
    """``load_yaml`` of a text that many bags carry, read once; what it gives is not to be changed."""
    return load_yaml(text)


def dump_yaml(content: Any) -> str:
    """A YAML text in the order of the mapping's keys, by libyaml likewise."""
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(content, Dumper=dumper, sort_keys=False, allow_unicode=True))


def parse_yaml(text: str, where: str, load: Callable[[str], Any] = load_yaml) -> Any:
    """What a YAML text holds; ``where`` opens the error."""
    try:
        return load(text)
    except yaml.YAMLError as error:
        raise InputError(f"{where}: not YAML: {' '.join(str(error).split())}") from None
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        # PyYAML's own, where a scalar is not of the kind that its tag or form says: a month 13, !!int of nothing.
        raise InputError(f"{where}: not YAML: {type(error).__name__}: {' '.join(str(error).split())}") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file."""
    content = parse_yaml(read_text(path, "a YAML file"), str(path))
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected a mapping of keys to values at the top, got {type(content).__name__}")
    return content


def parse_json(text: str, where: str) -> Any:
    """What a JSON text holds; ``where`` opens the error."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # the latter: nested too deep
        raise InputError(f"{where}: not JSON: {error}") from None


def read_json(path: Path, remedy: str = "") -> Any:
    """What a JSON file holds; ``remedy`` as in ``read_text``."""
    return parse_json(read_text(path, "a JSON file", remedy), str(path))


def write_json(path: Path, content: object) -> None:
    """Write JSON to ``path``, whole or not at all. Raises InputError where it can't be written."""
    with writing(path):
        write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def append_line(path: Path, content: object) -> None:
    """Append ``content`` as one line of JSON. Raises InputError where it can't be written."""
    # Half a character, which JSON may hold and UTF-8 may not, is written as JSON escapes it.
    with writing(path), path.open("a", encoding="utf-8", errors="backslashreplace") as file:
        file.write(json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n")


def read_csv(
    path: Path, needed: str = "a CSV file", matters: Callable[[str], bool] = bool
) -> tuple[list[str], Iterator[tuple[int, dict[str, str]]]]:
    """Column names of a CSV file, and its rows: (number in the file, text by column), stripped; empty rows left out.

    Tabs or semicolons may stand for the commas, or what a first line such as ``sep=;`` names, or spaces in a table that
    has nothing else, and then a comma in a number for its point. A title or lines with # may stand on top; the last of
    these is the header where none follows; where it stands again, as files put behind each other have it, it is left
    out. No column that ``matters`` may be there twice.
    """
    text = read_text(path, needed)
    try:
        table = _table(text)
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
_Rows = list[tuple[int, list[str]]]


@dataclass(frozen=True)
class _Table:
    """A text as one separator splits it: its header, and the rows below with their numbers, empty ones left out."""

    separator: str
    header: list[str]
    rows: _Rows

    @property
    def fit(self) -> tuple[bool, bool, int, int]:
        """The larger, the likelier this is the separator: rows as long as the header, names in it (no numbers, nothing
        that was cut inside its quotes), few lines above it, many columns.
        """
        width = len(self.header)
        even = width > 1 and {len(cells) for _, cells in self.rows} == {width}
        first = self.rows[0][0] if self.rows else 0
        names = not any(NUMBER.fullmatch(cell) or '"' in cell for cell in self.header)
        return even, names, -first, width

    @property
    def is_one(self) -> bool:
        """Whether its rows are as long as the header, and the header has names."""
        even, names, *_ = self.fit
        return even and names


def _table(text: str) -> _Table:
    """The table by the separator that the first line names, or that fits best. Raises csv.Error if none does."""
    if named := _SEP_LINE.match(text):
        # An empty line in its place: the rows keep their numbers.
        return _split(text[named.end() :], named[1])
    found, errors = [], []
    for separator in [sign for sign in ",\t;" if sign in text] or [","]:
        try:
            found.append(_split(text, separator))
        except csv.Error as error:
            errors.append(error)
    if not any(table.is_one for table in found):
        with suppress(csv.Error):
            found += filter(lambda table: table.is_one, [_split(_spaced(text), " ")])
    if not found:
        raise errors[0]
    return max(found, key=lambda table: table.fit)


def _spaced(text: str) -> str:
    """One space between words, and none behind the # of a remark, which numpy puts there."""
    lines = (" ".join(line.split()) for line in text.split("\n"))
    return "\n".join(re.sub("^#+ ", "#", line) for line in lines)


def _split(text: str, separator: str) -> _Table:
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True, skipinitialspace=True)
    # The mark of its encoding stands inside where a file was put behind another.
    lines = [[cell.strip().strip("\ufeff").strip() for cell in line] for line in reader]
    header, first = _header(lines)
    rows = [(at, cells) for at, cells in enumerate(lines[first:], start=first + 1) if any(cells) and cells != header]
    # R numbers its rows, and names no column for that.
    if rows and [cells[: -len(header)] for _, cells in rows] == [[str(at + 1)] for at in range(len(rows))]:
        header = ["", *header]
    return _Table(separator, header, rows)


def _header(lines: list[list[str]]) -> tuple[list[str], int]:
    """The header, and which line is the first below it. Lines with a # in front, and a single cell above several, are
    above the header; but where numbers follow at once, the last remark of as many cells is it, as numpy writes it.
    """
    wide = any(sum(map(bool, line)) > 1 for line in lines if not _remark(line))
    for number, line in enumerate(lines):
        if not any(line) or _remark(line) or (wide and sum(map(bool, line)) < 2):
            continue
        if any(map(NUMBER.fullmatch, line)):
            for names in map(_remark, reversed(lines[:number])):
                if len(names) == len(line) and not any(map(NUMBER.fullmatch, names)):
                    return names, number
        return line, number + 1
    return [], len(lines)


def _remark(line: list[str]) -> list[str]:
    """The cells of a line with a # in front, without it; none of another line."""
    return [line[0].lstrip("# \t"), *line[1:]] if line and line[0].startswith("#") else []


def _with_points(path: Path, header: list[str], rows: _Rows) -> _Rows:
    """The rows with a point for the comma in numbers. Raises InputError if there are numbers with a point, too: one of
    the signs would stand between thousands, and nobody could tell which; nor can they where the one sign there is
    stands nowhere but as between thousands. Columns with words in them do not count.
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
            raise InputError(f"{path}: row {number}: {len(cells)} values for {len(header)} columns")
        yield number, dict(zip(header, cells, strict=True))
