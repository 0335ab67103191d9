r"""The wire format, in both directions: lines of ASCII with a checksum, some followed by a block of bytes.

    <kind> <value> <value> ... *<checksum>\n

``kind`` is one capital letter, values are decimal numbers, the checksum is the exclusive or of all bytes before the
``*`` in two hexadecimal digits. A line with a wrong checksum is dropped and counted; the next one comes soon.

    host to legs     S t_us angle... rate...          set-point for the host's time [us]: angles (rad), rates (rad/s)
                                                      (CLOCK_MONOTONIC, which is never set)
    legs to host     L t_us angle... rate... effort.. where the legs are (rad, rad/s, N m) at the device's time [us]
                     E t_us                           the sync LED went on
    host to bed      B level                          blower, 0 to 1
    bed to host      H height_m                       height of the surface
    any device       W code                           its watchdog acted: 1 legs at rest, 2 air off
    camera to host   C t_us length crc32              the middle of an exposure; a JPEG of so many bytes follows
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

LEGS_AT_REST, AIR_OFF = 1, 2
"""Codes of W."""
_LONGEST_LINE, _LONGEST_BLOCK = 1024, 4 << 20


@dataclass(frozen=True)
class Line:
    """One message; ``block`` is empty except for frames."""

    kind: str
    values: tuple[float, ...]
    block: bytes = b""


def encode(kind: str, *values: float) -> bytes:
    """A line. Integers stay integers, other numbers get five decimals."""
    words = [kind, *(str(value) if isinstance(value, int) else f"{value:.5f}" for value in values)]
    body = " ".join(words).encode("ascii") + b" "
    return body + b"*%02X\n" % _checksum(body)


def encode_block(kind: str, t_us: int, block: bytes) -> bytes:
    """A line and its block."""
    return encode(kind, t_us, len(block), zlib.crc32(block)) + block


def decode(raw: bytes) -> Line | None:
    """The message in a line without its newline; None if it is malformed or its checksum is wrong."""
    body, star, given = raw.rpartition(b"*")
    try:
        if not star or len(given) != 2 or int(given, 16) != _checksum(body):
            return None
        kind, *values = body.decode("ascii").split()
        if len(kind) != 1 or not kind.isupper():
            return None
        return Line(kind, tuple(map(_number, values)))
    except ValueError:
        return None


class Reader:
    """Parses incoming bytes into messages; ``damaged`` counts invalid ones."""

    def __init__(self) -> None:
        self.damaged = 0
        self._rest = bytearray()
        self._awaited: Line | None = None

    def feed(self, data: bytes) -> Iterator[Line]:
        """The messages that are now complete."""
        self._rest += data
        while (line := self._next()) is not None:
            yield line

    def _next(self) -> Line | None:
        while True:
            if self._awaited is not None:
                length = int(self._awaited.values[1])
                if len(self._rest) < length:
                    return None
                line, block = self._awaited, bytes(self._rest[:length])
                del self._rest[:length]
                self._awaited = None
                if zlib.crc32(block) == line.values[2]:
                    return Line(line.kind, line.values, block)
                self.damaged += 1
            end = self._rest.find(b"\n")
            if end < 0:
                if len(self._rest) > _LONGEST_LINE:
                    self.damaged += 1
                    self._rest.clear()
                return None
            line_read = decode(bytes(self._rest[:end]))
            del self._rest[: end + 1]
            if line_read is None:
                self.damaged += 1
            elif line_read.kind != "C":
                return line_read
            elif len(line_read.values) == 3 and 0 <= line_read.values[1] <= _LONGEST_BLOCK:
                self._awaited = line_read
            else:
                self.damaged += 1


def split(values: Sequence[float], legs: int) -> list[list[float]]:
    """Values in groups of one per leg. Raises ValueError if they don't divide evenly."""
    if not legs or not values or len(values) % legs:
        raise ValueError(f"{len(values)} values for {legs} legs")
    return [list(values[start : start + legs]) for start in range(0, len(values), legs)]


def _number(text: str) -> float:
    return int(text) if text.lstrip("-").isdigit() else float(text)


def _checksum(body: bytes) -> int:
    found = 0
    for byte in body:
        found ^= byte
    return found
