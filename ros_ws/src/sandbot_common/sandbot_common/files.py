"""Files that are whole or not there, and text, YAML, JSON and CSV that are what they should be.

Every reader raises InputError in one line that names the file and what is wrong with it.
"""

import codecs
import csv
import io
import json
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from itertools import dropwhile
from pathlib import Path
from typing import Any

import yaml

from sandbot_common.errors import InputError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside ``path``; rename it onto ``path`` on success, remove it on any failure."""
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


def write_text(path: Path, text: str) -> None:
    """Write ``text`` (UTF-8) to ``path``, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def check_output(path: Path) -> Path:
    """``path``, if a file can be written there: told before minutes of work, not after. Raises InputError."""
    if path.is_dir():
        raise InputError(f"{path}: can't be written: it is a folder, a file is needed")
    above = next(parent for parent in path.absolute().parents if parent.exists())
    if not above.is_dir():
        raise InputError(f"{path}: can't be written: {above} is not a folder")
    if not os.access(above, os.W_OK | os.X_OK):
        raise InputError(f"{path}: can't be written: no permission to write in {above}")
    return path


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """A disk that refuses ``path`` after all is bad input, too."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: can't be written: {error.strerror}") from None


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
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file (UTF-8); {needed} is needed") from None


def _decoded(content: bytes) -> str:
    """UTF-8, or UTF-16 by its mark: nearly any bytes are UTF-16, so without a letter of ASCII they are no text here."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16")
        if any(letter.isascii() and letter.isalpha() for letter in text):
            return text
    return content.decode("utf-8-sig")


def load_yaml(text: str) -> Any:
    """What a YAML text holds, by libyaml where the wheel has it: ten times the speed of the Python loader."""
    return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))


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


def read_csv(path: Path, needed: str = "a CSV file") -> tuple[list[str], Iterator[tuple[int, dict[str, str]]]]:
    """Column names of a CSV file, and its rows: (number in the file, text by column), stripped; empty rows left out.

    Tabs or semicolons may stand for the commas, and then a comma in a number for its point; a title or lines with # may
    stand on top.
    """
    try:
        text = read_text(path, needed)
        separator = next((sign for sign in "\t;" if _separates(sign, text)), ",")
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True, skipinitialspace=True)
        lines = list(reader)
    except csv.Error as error:
        raise InputError(f"{path}: not a CSV: {error}") from None
    if separator != ",":
        lines = [[_with_point(cell) for cell in line] for line in lines]
    above = _above_the_header(lines)
    lines = lines[above:]
    header = [" ".join(name.split()) for name in lines[0]] if lines else []
    if repeated := [name for index, name in enumerate(header) if name and name in header[:index]]:
        raise InputError(f"{path}: row 1: column {repeated[0]} is there twice")
    return header, _csv_rows(path, header, lines, above)


def _separates(sign: str, text: str) -> bool:
    """Whether a sign stands between the values: no comma does, or a header has none and each line as many signs."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    table = list(dropwhile(lambda line: sign not in line, lines))
    if not table or "," not in text:
        return bool(table)
    return "," not in table[0] and len({line.count(sign) for line in table}) == 1


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if re.fullmatch(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*", cell) else cell


def _above_the_header(lines: list[list[str]]) -> int:
    """How many lines are a title or remarks: with a # in front, or a single cell above a line of several."""
    wide = any(sum(map(bool, line)) > 1 for line in lines)
    for number, line in enumerate(lines):
        remark = bool(line) and line[0].lstrip().startswith("#")
        if not remark and not (wide and sum(map(bool, line)) < 2):
            return number
    return 0


def _csv_rows(
    path: Path, header: list[str], lines: list[list[str]], above: int
) -> Iterator[tuple[int, dict[str, str]]]:
    for number, line in enumerate(lines[1:], start=above + 2):
        cells = [cell.strip() for cell in line]
        if len(cells) != len(header) and any(cells):
            raise InputError(f"{path}: row {number}: {len(cells)} values for {len(header)} columns")
        if any(cells):
            yield number, dict(zip(header, cells, strict=True))
