"""Writes one .mcap file such that a crash loses only what was not flushed, and a damaged chunk only itself.

The records are `mcap`'s; the chunks are assembled here because `mcap.writer` lacks three things: schemas and channels
are written outside the chunks (so damage to the first chunk does not make the others unreadable), a chunk is written as
a list of parts without concatenating them, and its CRC is updated as the parts arrive. MCAP 1.0: https://mcap.dev/spec.
"""

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
COMPRESSIONS = ("none", "lz4", "zstd")
ROS2 = "ros2"
"""The MCAP profile of files that follow the ROS 2 conventions."""
LIBRARY = "sandbot_record 0.1"
_MESSAGE_HEADER = struct.Struct("<BQHIQQ")
_INDEX_ENTRY = struct.Struct("<QQ")
_DATA_END = struct.Struct("<BQI")
_FOOTER = struct.Struct("<BQQQI")
_MAX_PARTS = 512
"""Parts per writev call, which takes at most 1024 (IOV_MAX)."""


class McapWriter:
    """Writes one file. Every method may raise OSError when the disk is full; the file then ends in a partial record."""

    def __init__(
        self, path: Path, *, compression: str = "none", chunk_size: int = 1 << 20, profile: str = ROS2
    ) -> None:
        self._begin(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), compression, chunk_size)
        self._write([MAGIC, _record(Header(profile=profile, library=LIBRARY))])

    @classmethod
    def reopened(cls, path: Path) -> "McapWriter":
        """Reopen a file that this class closed, to append to it; it has no summary until it is closed again."""
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
            file.seek(-_FOOTER.size - len(MAGIC), os.SEEK_END)
            end = _FOOTER.unpack(file.read(_FOOTER.size))[2] - _DATA_END.size
            file.seek(max(end, 0))
            found = file.read(_DATA_END.size)
        if summary is None or summary.statistics is None or found != _DATA_END.pack(Opcode.DATA_END, 4, 0):
            raise ValueError(f"{path}: not a file that McapWriter has closed")
        writer = cls.__new__(cls)
        writer._begin(os.open(path, os.O_WRONLY), "none", 1 << 20)
        writer._schemas, writer._channels = list(summary.schemas.values()), list(summary.channels.values())
        writer._chunks = summary.chunk_indexes
        writer._others = [*summary.attachment_indexes, *summary.metadata_indexes]
        writer._counts.update(summary.statistics.channel_message_counts)
        writer._cut(end, {})
        return writer

    def _begin(self, fd: int, compression: str, chunk_size: int) -> None:
        self._fd, self._offset, self._stat = fd, 0, os.fstat(fd)
        self._compression = "" if compression == "none" else compression
        self._chunk_size = chunk_size
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._others: list[AttachmentIndex | MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._chunk_counts: list[dict[int, int]] = []
        self._good = 0
        self._crc = 0
        self._start_chunk()

    @property
    def count(self) -> int:
        """Messages so far."""
        return sum(self._counts.values())

    @property
    def span(self) -> tuple[int, int]:
        """First and last log time [ns] in the closed chunks; zeros if there are none."""
        chunks = self._chunks
        if not chunks:
            return 0, 0
        return min(chunk.message_start_time for chunk in chunks), max(chunk.message_end_time for chunk in chunks)

    @property
    def can_drop(self) -> bool:
        """Whether there is still a chunk that could be discarded."""
        return bool(self._chunks)

    def drop_torn(self) -> dict[int, int]:
        """Discard the partial record of a failed write and the open chunk, so that the file can be closed. Returns how
        many messages of each channel were lost.
        """
        dropped = {channel: len(entries) for channel, entries in self._index.items()} if self._parts else {}
        self._start_chunk()
        return self._cut(self._good, dropped)

    def drop_last_chunk(self) -> dict[int, int]:
        """Discard the last closed chunk and all that follows it to free space; returns the same as ``drop_torn``."""
        start = self._chunks.pop().chunk_start_offset
        return self._cut(start, self._chunk_counts.pop())

    def _cut(self, at: int, dropped: dict[int, int]) -> dict[int, int]:
        for channel, number in dropped.items():
            self._counts[channel] -= number
        self._others = [index for index in self._others if index.offset < at]
        os.ftruncate(self._fd, at)
        os.lseek(self._fd, at, os.SEEK_SET)
        self._offset = self._good = at
        return dropped

    @property
    def size(self) -> int:
        """Bytes in the file and in the open chunk."""
        return self._offset + self._chunk_bytes

    def add_channel(self, topic: str, encoding: str, schema: Schema | None, metadata: Mapping[str, str]) -> int:
        """Register a channel and return its id; the schema, if any, is given an id here."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
            schema_id=0 if schema is None else self._schema_id(schema),
        )
        self._channels.append(channel)
        self._write([_record(channel)])
        return len(self._channels)

    def _schema_id(self, wanted: Schema) -> int:
        """The id of a schema, which is written if it is new."""
        for number, known in enumerate(self._schemas, start=1):
            if replace(wanted, id=number) == known:
                return number
        self._schemas.append(replace(wanted, id=len(self._schemas) + 1))
        self._write([_record(self._schemas[-1])])
        return len(self._schemas)

    def add_message(
        self, channel: int, log_time_ns: int, publish_time_ns: int, data: bytes | memoryview, sequence: int = 0
    ) -> None:
        """Append a message to the open chunk; the chunk is written when it is full."""
        header = _MESSAGE_HEADER.pack(
            Opcode.MESSAGE, 22 + len(data), channel, sequence & 0xFFFFFFFF, log_time_ns, publish_time_ns
        )
        self._index[channel].append((log_time_ns, self._chunk_bytes))
        self._parts += (header, data)
        self._crc = zlib.crc32(data, zlib.crc32(header, self._crc))
        self._chunk_bytes += len(header) + len(data)
        self._counts[channel] += 1
        if self._chunk_bytes >= self._chunk_size:
            self._finish_chunk()

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record now."""
        record = _record(Metadata(name=name, metadata=dict(values)))
        index = MetadataIndex(offset=self._offset, length=len(record), name=name)
        self._write([record])
        self._others.append(index)

    def add_attachment(self, name: str, data: bytes, media_type: str, time_ns: int) -> None:
        """Write an attachment now."""
        record = _record(Attachment(create_time=time_ns, log_time=time_ns, name=name, media_type=media_type, data=data))
        index = AttachmentIndex(
            offset=self._offset,
            length=len(record),
            log_time=time_ns,
            create_time=time_ns,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._write([record])
        self._others.append(index)

    def is_at(self, path: Path) -> bool:
        """Whether ``path`` leads to this file, open or closed. Raises OSError if the disk can't say."""
        try:
            return os.path.samestat(os.stat(path), self._stat)
        except (FileNotFoundError, NotADirectoryError):
            return False

    def flush(self, *, fsync: bool = False) -> None:
        """Close the open chunk: the messages so far survive a crash of this process (and, with fsync, a power cut)."""
        self._finish_chunk()
        if fsync:
            os.fdatasync(self._fd)

    def close(self) -> None:
        """Write the last chunk, the summary and the footer."""
        if self._fd < 0:
            return
        self._finish_chunk()
        self._write_end()
        self.abandon()

    def abandon(self) -> None:
        """Close the file as it is, without a summary: unfinished, but recoverable."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _start_chunk(self) -> None:
        self._parts: list[bytes | memoryview] = []
        self._index: dict[int, list[tuple[int, int]]] = defaultdict(list)
        self._chunk_bytes = 0
        self._crc = 0

    def _finish_chunk(self) -> None:
        if not self._parts:
            return
        parts, size = self._parts, self._chunk_bytes
        if self._compression:
            parts = [_compress(b"".join(parts), self._compression)]
        data_size = sum(map(len, parts))
        times = [time for entries in self._index.values() for time, _ in entries]
        span = min(times), max(times)
        name = self._compression.encode()
        head = struct.pack(
            f"<BQQQQII{len(name)}sQ",
            Opcode.CHUNK,
            40 + len(name) + data_size,
            *span,
            size,
            self._crc,
            len(name),
            name,
            data_size,
        )
        start = self._offset
        indexes = {channel: _message_index(channel, entries) for channel, entries in self._index.items()}
        offsets, at = {}, start + len(head) + data_size
        for channel, record in indexes.items():
            offsets[channel] = at
            at += len(record)
        self._write([head, *parts, *indexes.values()])
        self._chunk_counts.append({channel: len(entries) for channel, entries in self._index.items()})
        self._chunks.append(
            ChunkIndex(
                chunk_start_offset=start,
                chunk_length=len(head) + data_size,
                message_start_time=span[0],
                message_end_time=span[1],
                message_index_offsets=offsets,
                message_index_length=sum(map(len, indexes.values())),
                compression=self._compression,
                compressed_size=data_size,
                uncompressed_size=size,
            )
        )
        self._start_chunk()

    def _write_end(self) -> None:
        """Write DataEnd, summary and footer at once, so that after a failure the end of the data section is known."""
        attachments = [index for index in self._others if isinstance(index, AttachmentIndex)]
        metadata = [index for index in self._others if isinstance(index, MetadataIndex)]
        statistics = Statistics(
            message_count=sum(self._counts.values()),
            schema_count=len(self._schemas),
            channel_count=len(self._channels),
            attachment_count=len(attachments),
            metadata_count=len(metadata),
            chunk_count=len(self._chunks),
            message_start_time=self.span[0],
            message_end_time=self.span[1],
            channel_message_counts=dict(self._counts),
        )
        groups: list[tuple[Opcode, list[bytes]]] = [
            (Opcode.SCHEMA, [_record(entry) for entry in self._schemas]),
            (Opcode.CHANNEL, [_record(entry) for entry in self._channels]),
            (Opcode.STATISTICS, [_record(statistics)]),
            (Opcode.CHUNK_INDEX, [_record(entry) for entry in self._chunks]),
            (Opcode.ATTACHMENT_INDEX, [_record(entry) for entry in attachments]),
            (Opcode.METADATA_INDEX, [_record(entry) for entry in metadata]),
        ]
        end = _record(DataEnd(0))
        summary_start = at = self._offset + len(end)
        offsets = []
        for opcode, records in groups:
            length = sum(map(len, records))
            if records:
                offsets.append(_record(SummaryOffset(group_opcode=opcode, group_start=at, group_length=length)))
            at += length
        summary = b"".join(record for _, records in groups for record in records) + b"".join(offsets)
        crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, at), zlib.crc32(summary))
        self._write([end, summary, _record(Footer(summary_start, at, crc)), MAGIC])

    def _write(self, parts: list[bytes | memoryview]) -> None:
        for first in range(0, len(parts), _MAX_PARTS):
            self._writev(parts[first : first + _MAX_PARTS])
        self._good = self._offset

    def _writev(self, parts: list[bytes | memoryview]) -> None:
        left = sum(map(len, parts))
        while left:
            done = os.writev(self._fd, parts)
            self._offset += done
            left -= done
            if left:  # a short write: continue after the bytes that were written
                parts = [memoryview(b"".join(parts))[done:]]


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _message_index(channel: int, entries: list[tuple[int, int]]) -> bytes:
    head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + 16 * len(entries), channel, 16 * len(entries))
    return head + b"".join(_INDEX_ENTRY.pack(*entry) for entry in entries)


def _compress(data: bytes, compression: str) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=1).compress(data)
    return bytes(lz4.frame.compress(data))
