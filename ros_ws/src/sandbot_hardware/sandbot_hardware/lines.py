r"""The wire format, in both directions: lines of ASCII with a checksum, some followed by a block of bytes.

    <kind> <value> <value> ... *<checksum>\n

``kind`` is one capital letter, values are decimal numbers, the checksum is the exclusive or of all bytes before the
``*`` in two hexadecimal digits. A line with a wrong checksum is dropped and counted; the next one comes soon. What
precedes a message on its line is ignored, as the rest of a frame that lost a byte does: nothing ends a block.

    host to legs     S t_us angle... rate...          set-point for the host's time [us]: angles (rad), rates (rad/s)
                                                      (CLOCK_MONOTONIC, which is never set)
    legs to host     L t_us angle... rate... effort.. where the legs are (rad, rad/s, N m) at the device's time [us]
                     E t_us                           the sync LED went on
    host to bed      B level                          blower, 0 to 1
    bed to host      H height_m                       height of the surface
    any device       W code                           its watchdog acted: 1 legs at rest, 2 air off
    camera to host   C t_us length crc32              the middle of an exposure; a JPEG of so many bytes follows
"""

import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

LEGS_AT_REST, AIR_OFF = 1, 2
"""Codes of W."""
_LONGEST_LINE, _LONGEST_BLOCK = 1024, 4 << 20
_MESSAGE = re.compile(rb"([A-Z][-+.0-9a-z ]*)\*([0-9A-Fa-f]{2})\Z")


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
    """The message at the end of a line without its newline; None if it is malformed or its checksum is wrong."""
    found = _MESSAGE.search(raw)
    if found is None or int(found[2], 16) != _checksum(found[1]):
        return None
    kind, values = found[1][:1].decode("ascii"), found[1][1:].decode("ascii").split()
    try:
        return Line(kind, tuple(map(_number, values)))
    except ValueError:
        return None


class Reader:
    """Parses incoming bytes into messages; ``damaged`` counts how often there was something else between them.

    ``in_step``: whether the last thing that was read is a valid line.
    """

    def __init__(self, damaged: int = 0) -> None:
        self.damaged = damaged
        self.in_step = True
        self._rest = bytearray()
        self._awaited: Line | None = None

    def feed(self, data: bytes) -> Iterator[Line]:
        """The messages that are now complete."""
        self._rest += data
        while (line := self._next()) is not None:
            self.in_step = True
            yield line

    def _next(self) -> Line | None:
        while True:
            if self._awaited is not None:
                line, length = self._awaited, int(self._awaited.values[1])
                if len(self._rest) < length:
                    return None
                self._awaited = None
                block = bytes(self._rest[:length])
                if zlib.crc32(block) == line.values[2]:
                    del self._rest[:length]
                    return Line(line.kind, line.values, block)
                self._lose_step()  # if bytes were lost, later messages begin in what was taken for the block
            end = self._rest.find(b"\n")
            if end < 0:
                if len(self._rest) > _LONGEST_LINE:
                    self._lose_step()
                    del self._rest[:-_LONGEST_LINE]  # the next message may have begun
                return None
            raw = bytes(self._rest[:end])
            del self._rest[: end + 1]
            read = decode(raw)
            if read is None or not _MESSAGE.match(raw):
                self._lose_step()
            if read is None:
                continue
            if read.kind != "C":
                return read
            if len(read.values) == 3 and 0 <= read.values[1] <= _LONGEST_BLOCK:
                self._awaited, self.in_step = read, True
            else:
                self._lose_step()

    def _lose_step(self) -> None:
        self.damaged += self.in_step
        self.in_step = False


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
