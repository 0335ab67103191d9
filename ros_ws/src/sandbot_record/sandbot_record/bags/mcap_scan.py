"""Reads one .mcap file, possibly damaged, block by block: yields what is intact and reports what is not.

Nothing in the file is trusted: every length is checked against the file, every chunk against its CRC, and after damage
scanning resumes at the next consistent chunk header. MCAP 1.0: https://mcap.dev/spec.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from typing import TypeAlias

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema
from numpy.typing import NDArray

from sandbot_record.bags.file_bytes import FileBytes

MAGIC = b"\x89MCAP0\r\n"
CHUNK_LIMIT = 768 << 20
"""Largest uncompressed size of a chunk [bytes]: a larger figure is damage (and would exhaust the memory). A chunk ends
with the message that fills it, and the recorder accepts only smaller ones (``recording.Limits``)."""
_RUN = 32 << 20
"""Largest run of unchunked messages that is read at once [bytes]."""

Definition: TypeAlias = Schema | Channel
Data: TypeAlias = bytes | memoryview | FileBytes
_PARSED = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}
MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<i8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time_ns", "<i8"),
        ("publish_time_ns", "<i8"),
    ]
)
_FOOTER_BYTES = 9 + 20
_CHUNK_HEAD = re.compile(
    rb"\x06.{5}\x00\x00\x00.{28}(?:\x00\x00\x00\x00|\x03\x00\x00\x00lz4|\x04\x00\x00\x00zstd).{5}\x00\x00\x00",
    re.DOTALL,
)
_CHUNK_HEAD_BYTES = 53
"""The longest match."""
_SEARCHED = 64 << 10
"""Bytes in which a chunk is looked for at once."""


@dataclass(frozen=True)
class Lost:
    """Messages of one channel in a damaged chunk, according to the index that follows it; times [ns]."""

    channel: int
    count: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True)
class Damage:
    """Unusable bytes [start, end) of the file, the reason, and which messages are lost, if known."""

    start: int
    end: int
    reason: str
    lost: tuple[Lost, ...] = ()


@dataclass(frozen=True)
class Batch:
    """The messages of one chunk (or of a run of unchunked ones), in file order; ``rows`` is (n,) of the header fields.

    Message i is ``data[at[i] : at[i] + length[i]]``. ``definitions`` are schemas and channels found among them;
    ``checked``: a CRC confirmed the bytes.
    """

    offset: int
    data: bytes | memoryview
    rows: NDArray[np.void]
    at: NDArray[np.int64]
    length: NDArray[np.int64]
    definitions: tuple[Definition, ...]
    checked: bool = False

    def payload(self, row: int) -> memoryview:
        """The bytes of message ``row``, not copied."""
        start = int(self.at[row])
        return memoryview(self.data)[start : start + int(self.length[row])]


@dataclass(frozen=True)
class End:
    """The end of the data section (DataEnd): what follows is only the summary."""

    offset: int


Item: TypeAlias = Header | Schema | Channel | Metadata | Attachment | Batch | Damage | End


def is_mcap(data: Data) -> bool:
    """Whether the bytes begin as an MCAP file does."""
    return bytes(data[: len(MAGIC)]) == MAGIC


def finished(data: Data) -> bool:
    """Whether the file ends in footer and magic bytes, as a properly closed file does."""
    if len(data) < len(MAGIC) + _FOOTER_BYTES + len(MAGIC) or bytes(data[-len(MAGIC) :]) != MAGIC:
        return False
    footer = bytes(data[-len(MAGIC) - _FOOTER_BYTES :][:9])
    return footer == struct.pack("<BQ", Opcode.FOOTER, 20)


def _summary_records(data: Data) -> Iterator[tuple[int, int, int]] | None:
    """The summary's records as ``_records`` gives them; None if there is no summary or its CRC is wrong."""
    if not finished(data):
        return None
    footer_at = len(data) - len(MAGIC) - _FOOTER_BYTES
    start, _, crc = struct.unpack("<QQI", data[footer_at + 9 : footer_at + 29])
    if not 0 < start <= footer_at or (crc and zlib.crc32(data[start : footer_at + 25]) != crc):
        return None
    return _records(data, start, footer_at)


def stated_count(data: Data) -> int | None:
    """The message count in the summary; None if there is none, or the summary is damaged."""
    for opcode, at, length in _summary_records(data) or ():
        if opcode == Opcode.STATISTICS and length >= 8:
            return int.from_bytes(data[at : at + 8], "little")
    return None


def summary(data: Data) -> list[Definition] | None:
    """The summary's schemas and channels; None if there is no summary or its CRC is wrong."""
    records = _summary_records(data)
    if records is None:
        return None
    found: list[Definition] = []
    for opcode, at, length in records:
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            record = _parse(opcode, data[at : at + length])
            if not isinstance(record, Schema | Channel):
                return None
            found.append(record)
    return found


def scan(data: Data) -> Iterator[Item]:
    """Everything in the data section, in file order, with a Damage for each part that is not usable."""
    at, size = len(MAGIC), len(data)
    if not is_mcap(data):
        at = 0
        yield Damage(0, min(len(MAGIC), size), "not the first bytes of an MCAP file")
        at = _next_chunk(data, 0)
    while at < size:
        length = _length(data, at)
        opcode = data[at]
        if length is None or not Opcode.HEADER <= opcode <= Opcode.DATA_END:
            resumed = _next_chunk(data, at + 1)
            yield Damage(at, resumed, "cut off" if resumed == size else "not a record")
            at = resumed
            continue
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            yield End(at)
            return
        end = at + 9 + length
        if opcode == Opcode.MESSAGE:
            end = _end_of_messages(data, at)
            yield from _batch(data[at:end], at)
        elif opcode == Opcode.CHUNK:
            for item in _chunk(data, at, end):
                if isinstance(item, Damage):
                    if not _plausible(data, end):
                        end = _next_chunk(data, at + 1)
                    item = replace(item, end=end, lost=_lost_by_index(data, end))
                yield item
        elif opcode in _PARSED:
            record = _parse(opcode, data[at + 9 : end])
            yield Damage(at, end, f"damaged {Opcode(opcode).name.lower()} record") if record is None else record
        at = end


def batch_at(data: Data, offset: int) -> Batch | None:
    """Read again the batch that ``scan`` found at this offset; None if it has been overwritten meanwhile."""
    if data[offset] == Opcode.CHUNK:
        end = offset + 9 + (_length(data, offset) or 0)
        found = _chunk(data, offset, end)
    else:
        found = _batch(data[offset : _end_of_messages(data, offset)], offset)
    return next((item for item in found if isinstance(item, Batch)), None)


def _length(data: Data, at: int) -> int | None:
    """Length of the record at ``at``; None if it does not fit into the file."""
    if at + 9 > len(data):
        return None
    length = int.from_bytes(data[at + 1 : at + 9], "little")
    return length if at + 9 + length <= len(data) else None


def _lost_by_index(data: Data, at: int) -> tuple[Lost, ...]:
    """The messages of the damaged chunk before ``at``, according to the message indexes that begin there."""
    lost = []
    for opcode, start, length in _records(data, at, len(data)):
        if opcode != Opcode.MESSAGE_INDEX or length < 22 or (length - 6) % 16:
            break
        channel = int.from_bytes(data[start : start + 2], "little")
        times = np.frombuffer(data[start + 6 : start + length], dtype="<i8")[::2]
        lost.append(Lost(channel, len(times), int(times.min()), int(times.max())))
    return tuple(lost)


def _plausible(data: Data, at: int) -> bool:
    return at == len(data) or (_length(data, at) is not None and Opcode.HEADER <= data[at] <= Opcode.DATA_END)


def _next_chunk(data: Data, at: int) -> int:
    """The next offset from ``at`` on of a chunk whose lengths are consistent; the file's end if there is none."""
    for begin in range(at, len(data), _SEARCHED):
        for match in _CHUNK_HEAD.finditer(data[begin : begin + _SEARCHED + _CHUNK_HEAD_BYTES]):
            start = begin + match.start()
            length = _length(data, start)
            if length is not None and _chunk_body(data, start, start + 9 + length) is not None:
                return start
    return len(data)


def _chunk_body(data: Data, at: int, end: int) -> tuple[int, int, str, int] | None:
    """Uncompressed size, CRC, compression and offset of the compressed bytes; None if the lengths are inconsistent."""
    if end - at < 9 + 40:
        return None
    size, crc, name_length = struct.unpack("<QII", data[at + 25 : at + 41])
    if name_length > 4 or at + 49 + name_length > end:
        return None
    name = bytes(data[at + 41 : at + 41 + name_length])
    (data_size,) = struct.unpack("<Q", data[at + 41 + name_length : at + 49 + name_length])
    if at + 49 + name_length + data_size != end or name not in (b"", b"lz4", b"zstd"):
        return None
    return size, crc, name.decode(), at + 49 + name_length


def _chunk(data: Data, at: int, end: int) -> Iterator[Batch | Damage]:
    body = _chunk_body(data, at, end)
    if body is None:
        yield Damage(at, end, "chunk header disagrees with itself")
        return
    size, crc, compression, start = body
    content = _decompressed(data[start:end], compression, size)
    if content is None:
        yield Damage(at, end, f"{compression or 'chunk'} data can't be decompressed")
    elif crc and zlib.crc32(content) != crc:
        yield Damage(at, end, "chunk CRC is wrong")
    else:
        batch = _by_index(content, data, end, at) if crc else None
        if batch is None:
            yield from _batch(content, at, checked=bool(crc))
        else:
            yield batch


def _by_index(content: bytes | memoryview, data: Data, at: int, offset: int) -> Batch | None:
    """The batch of a chunk whose CRC is right, from the message indexes at ``at``, without a loop over messages.

    None if the indexed messages do not fill the chunk without a gap: then the chunk must be parsed record by record.
    """
    found = []
    for opcode, start, length in _records(data, at, len(data)):
        if opcode != Opcode.MESSAGE_INDEX or length < 22 or (length - 6) % 16:
            break
        found.append(np.frombuffer(data[start + 6 : start + length], dtype="<i8")[1::2])
    if not found:
        return None
    starts = np.sort(np.concatenate(found))
    if starts[0] != 0 or starts[-1] < 0 or starts[-1] + MESSAGE.itemsize > len(content):
        return None
    rows = _headers(content, starts)
    ends = starts + 9 + rows["length"]
    tiled = (ends[:-1] == starts[1:]).all() and ends[-1] == len(content)
    if not tiled or (rows["opcode"] != Opcode.MESSAGE).any() or (rows["length"] < 22).any():
        return None
    return Batch(offset, content, rows, starts + MESSAGE.itemsize, rows["length"] - 22, (), checked=True)


def _headers(data: bytes | memoryview, starts: NDArray[np.int64]) -> NDArray[np.void]:
    """The header fields of the message records that begin at ``starts``."""
    raw = np.frombuffer(data, dtype=np.uint8)
    rows: NDArray[np.void] = raw[starts[:, None] + np.arange(MESSAGE.itemsize)].reshape(-1).view(MESSAGE)
    return rows


def _decompressed(data: bytes | memoryview, compression: str, size: int) -> bytes | memoryview | None:
    """The chunk's content, exactly ``size`` bytes; None if it can't be decompressed to that."""
    if compression and size > CHUNK_LIMIT:
        return None
    try:
        if compression == "zstd":
            if zstandard.frame_content_size(data) > size:
                return None
            content: bytes | memoryview = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        elif compression == "lz4":
            content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        else:
            content = data
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError, ValueError):
        return None
    return content if len(content) == size else None


def _records(data: Data, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """(opcode, offset of the content, length) of each record in [at, end); stops at one that does not fit."""
    unpack = struct.Struct("<BQ").unpack
    while at + 9 <= end:
        opcode, length = unpack(data[at : at + 9])
        at += 9
        if at + length > end:
            return
        yield opcode, at, length
        at += length


def _end_of_messages(data: Data, at: int) -> int:
    """End of the run of message records (and of definitions between them) that begins at ``at``."""
    end = first = at
    for opcode, start, length in _records(data, at, len(data)):
        if opcode not in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL) or end - first > _RUN:
            break
        end = start + length
    return end


def _batch(data: bytes | memoryview, offset: int, *, checked: bool = False) -> Iterator[Batch | Damage]:
    """The messages in ``data``, which begin at ``offset`` of the file; Damage if the records do not fill it."""
    starts: list[int] = []
    definitions: list[Definition] = []
    last = 0
    for opcode, start, length in _records(data, 0, len(data)):
        last = start + length
        if opcode == Opcode.MESSAGE and length >= 22:
            starts.append(start - 9)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            record = _parse(opcode, data[start:last])
            if isinstance(record, Schema | Channel):
                definitions.append(record)
    at_header = np.array(starts, dtype=np.int64)
    rows = _headers(data, at_header)
    yield Batch(offset, data, rows, at_header + MESSAGE.itemsize, rows["length"] - 22, tuple(definitions), checked)
    if last != len(data):
        yield Damage(offset, offset, f"{len(data) - last} bytes of a block are not records")


def _parse(opcode: int, content: bytes | memoryview) -> Header | Schema | Channel | Metadata | Attachment | None:
    """The record; None if the bytes are not a valid one."""
    try:
        record = _PARSED[Opcode(opcode)].read(ReadDataStream(BytesIO(content)))
    except (McapError, struct.error, ValueError, OverflowError, MemoryError):
        return None
    return record
