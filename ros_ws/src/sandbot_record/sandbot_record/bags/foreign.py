"""Bags whose storage is not plain MCAP (sqlite3, whole files or messages compressed), read through rosbags."""

import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from mcap.records import Schema
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2 import Reader

from sandbot_common.errors import InputError
from sandbot_record.bags import metadata
from sandbot_record.bags.definitions import Definitions
from sandbot_record.bags.interfaces import ROS2IDL, ROS2MSG, Interface
from sandbot_record.bags.mcap_scan import MESSAGE, Batch

_PER_BATCH = 1000
_ENCODINGS = {MessageDefinitionFormat.MSG: ROS2MSG, MessageDefinitionFormat.IDL: ROS2IDL}


def is_foreign(path: Path, info: metadata.BagInfo | None) -> bool:
    """Whether a storage file needs rosbags."""
    return path.suffix != ".mcap" or (info is not None and bool(info.compression))


def items(bag: Path, files: list[Path], definitions: Definitions) -> Iterator[tuple[Batch, Definitions]]:
    """All messages in batches, each with ``definitions``, to which the bag's own are added.

    Raises InputError with rosbags' reason if rosbags can't read the bag.
    """
    try:
        with Reader(bag) as reader:
            for connection in reader.connections:
                qos = tuple(getattr(connection.ext, "offered_qos_profiles", ()))
                interface = _interface(connection, definitions.release)
                definitions.topics[connection.id] = metadata.TopicInfo(connection.topic, interface, qos)
            stream = reader.messages()
            while part := [(connection.id, time, bytes(data)) for connection, time, data in islice(stream, _PER_BATCH)]:
                yield _batch(part), definitions
    except InputError:
        raise
    except Exception as error:  # rosbags, sqlite3 and zstd each raise their own kinds
        names = ", ".join(file.name for file in files)
        raise InputError(f"{bag}: rosbags can't read {names}: {' '.join(str(error).split())}") from None


def _interface(connection: Connection, release: str) -> Interface:
    kind, text = connection.msgdef.format, connection.msgdef.data
    schema = Schema(0, text.encode(), _ENCODINGS[kind], connection.msgtype) if kind in _ENCODINGS else None
    return Interface(connection.msgtype, connection.digest, schema=schema, release=release)


def _batch(messages: list[tuple[int, int, bytes]]) -> Batch:
    header = struct.Struct("<BQHIQQ").pack
    parts: list[bytes] = []
    at = []
    size = 0
    for channel, time, data in messages:
        at.append(size + MESSAGE.itemsize)
        parts += (header(5, 22 + len(data), channel, 0, time, time), data)
        size += MESSAGE.itemsize + len(data)
    start = np.array(at, dtype=np.int64)
    data = b"".join(parts)
    raw = np.frombuffer(data, np.uint8)
    rows = raw[start[:, None] - MESSAGE.itemsize + np.arange(MESSAGE.itemsize)].reshape(-1).view(MESSAGE)
    return Batch(0, data, rows, start, rows["length"] - 22, ())
