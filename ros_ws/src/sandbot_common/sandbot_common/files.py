"""Atomic writing of files, and checked reading of text and JSON.

Every reader raises InputError in one line that names the file and what is wrong with it.
"""

import codecs
import errno
import json
import os
import re
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sandbot_common.errors import InputError


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
    temporary = temporary_name(path)
    temporary.touch(exist_ok=False)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def temporary_name(path: Path) -> Path:
    """A new hidden name next to ``path``.

    Not of ``tempfile``, whose files only their owner may read, nor widened by the umask, which other threads share.
    """
    return path.parent / f".{path.name}.{secrets.token_hex(4)}"


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
