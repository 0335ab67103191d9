"""The bytes of a file, read as they are asked for.

A memory map would be as fast, but a file that is truncated while it is read, or whose disk is lost, then ends the
process (SIGBUS), a campaign's too. Here it is an error in one line.
"""

import os
import weakref
from pathlib import Path
from typing import overload

from sandbot_common.errors import InputError

_WINDOW = 64 << 10
"""Reads smaller than this are taken from a part of the file of this size, which is kept."""


class FileLost(InputError):
    """A file that can no longer be read: reading on is of no use."""


class FileBytes:
    """A file that was opened for reading: a slice of it is bytes, and an index one byte, as of bytes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._window = (0, b"")
        try:
            self._fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            weakref.finalize(self, os.close, self._fd)
            self._size = os.fstat(self._fd).st_size
        except OSError as error:
            raise FileLost(f"{path}: {error.strerror}") from None

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, key: int) -> int: ...

    @overload
    def __getitem__(self, key: slice) -> bytes: ...

    def __getitem__(self, key: int | slice) -> int | bytes:
        """Raises FileLost if the file can't be read, or has become shorter."""
        if isinstance(key, int):
            return self._part(key, key + 1)[0]
        start, end, _ = key.indices(self._size)
        return self._part(start, max(start, end))

    def _part(self, start: int, end: int) -> bytes:
        if end - start >= _WINDOW:
            return self._read(start, end)
        first, kept = self._window
        if not first <= start <= end <= first + len(kept):
            first, kept = start, self._read(start, min(start + _WINDOW, self._size))
            self._window = first, kept
        return kept[start - first : end - first]

    def _read(self, start: int, end: int) -> bytes:
        parts = []
        while start < end:
            try:
                part = os.pread(self._fd, end - start, start)
            except OSError as error:
                raise FileLost(f"{self.path}: {error.strerror}") from None
            if not part:
                left = os.fstat(self._fd).st_size
                raise FileLost(f"{self.path}: was truncated from {self._size} to {left} bytes while it was read")
            parts.append(part)
            start += len(part)
        return parts[0] if len(parts) == 1 else b"".join(parts)
