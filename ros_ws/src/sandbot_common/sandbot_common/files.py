"""Files that are whole or not there, and text, YAML, JSON and CSV that are what they should be.

Every reader raises InputError in one line that names the file and what is wrong with it.
"""

import csv
import io
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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
    above = next(one for one in path.absolute().parents if one.exists())
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
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{remedy}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, {needed} is needed") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file (UTF-8); {needed} is needed") from None


def load_yaml(text: str) -> Any:
    """What a YAML text holds, by libyaml where the wheel has it: ten times the speed of the Python loader."""
    return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def dump_yaml(content: Any) -> str:
    """A YAML text in the order of the mapping's keys, by libyaml likewise."""
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(content, Dumper=dumper, sort_keys=False, allow_unicode=True))


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file."""
    try:
        content = load_yaml(read_text(path, "a YAML file"))
    except yaml.YAMLError as error:
        raise InputError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
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
    """Column names of a CSV file, and its rows: (number in the file, text by column), stripped; empty rows left out."""
    try:
        text = read_text(path, needed)
        lines = list(csv.reader(io.StringIO(text, newline=""), strict=True, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(f"{path}: not a CSV: {error}") from None
    header = [" ".join(name.split()) for name in lines[0]] if lines else []
    if repeated := [name for index, name in enumerate(header) if name and name in header[:index]]:
        raise InputError(f"{path}: row 1: column {repeated[0]} is there twice")
    return header, _csv_rows(path, header, lines)


def _csv_rows(path: Path, header: list[str], lines: list[list[str]]) -> Iterator[tuple[int, dict[str, str]]]:
    for number, line in enumerate(lines[1:], start=2):
        cells = [cell.strip() for cell in line]
        if len(cells) != len(header) and any(cells):
            raise InputError(f"{path}: row {number}: {len(cells)} values for {len(header)} columns")
        if any(cells):
            yield number, dict(zip(header, cells, strict=True))
