"""BagWriter: one rosbag2 bag folder (metadata.yaml + .mcap files), readable by `ros2 bag`, rosbags and mcap.

In batch (``whole=True``) the folder is written under a temporary name and renamed when closed: an interrupted trial
leaves nothing. Live (``whole=False``) it has its final name from the start and ``Recording`` flushes it every 0.1 s:
an interrupted recording leaves an unfinished bag that `recover` can complete.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Schema
from rosbags.interfaces import Qos

from sandbot_common.errors import InputError
from sandbot_common.files import sync, temporary_name
from sandbot_common.topics import Topic
from sandbot_record.bags import interfaces, metadata
from sandbot_record.bags.interfaces import ROS2MSG, Interface
from sandbot_record.bags.mcap_writer import COMPRESSIONS, ROS2, McapWriter

SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class Split:
    """When to begin a new file: after ``size`` bytes or ``seconds`` (0: never)."""

    size: int = 0
    seconds: float = 0.0


@dataclass
class _Channel:
    """A topic as it is written: its entry in metadata.yaml and its id in the current file."""

    info: metadata.TopicInfo
    id: int = 0


def add_metadata(bag: Path, name: str, values: Mapping[str, str]) -> None:
    """Add a metadata record to a complete bag; of several with one name the last applies.

    Raises InputError if it is not a complete bag written by this class, OSError if the disk is full (the bag then needs
    `recover`).
    """
    info = metadata.read(bag)
    files = [file for entry in info.files if (file := bag / entry.path).is_file()] if info else []
    if not files:
        raise InputError(f"{bag}: no bag")
    try:
        writer = McapWriter.reopened(files[-1])
    except (ValueError, McapError) as error:
        raise InputError(f"{files[-1]}: not complete, nothing can be added: {error}") from None
    try:
        writer.add_metadata(name, values)
        writer.close()
    finally:
        writer.abandon()


class BagWriter:
    """Writes a bag; a context manager. Raises InputError if the bag exists, OSError if the disk is full.

    ``flush_period_s``: longest time, on the clock of the log times, that a message stays in memory; 0 leaves
    flushing to full chunks. Not thread-safe.
    """

    def __init__(
        self,
        path: Path,
        *,
        compression: str = "none",
        chunk_size: int = 1 << 20,
        flush_period_s: float = 1.0,
        fsync: bool = False,
        split: Split = Split(),
        whole: bool = True,
        profile: str = ROS2,
    ) -> None:
        if compression not in COMPRESSIONS:
            raise InputError(f"{path}: compression {compression!r} is not one of {', '.join(COMPRESSIONS)}")
        if path.exists():
            raise InputError(f"{path}: exists already, not overwriting")
        try:
            str(path).encode()
        except UnicodeEncodeError:  # bytes of another encoding; metadata.yaml, which names its files, is UTF-8
            raise InputError(f"{str(path)!r}: not UTF-8; give the bag another name") from None
        self.path = path
        self._final = path
        self._split = split
        self._storage: dict[str, Any] = {"compression": compression, "chunk_size": chunk_size, "profile": profile}
        self._flush_ns, self._fsync = int(flush_period_s * SECOND_NS), fsync
        self._flushed_ns: int | None = None
        self._channels: dict[str, _Channel] = {}
        self.info = metadata.BagInfo(custom={"state": metadata.RECORDING})
        self._closed = False
        self._folder = self._make_folder(whole)
        self._open_file()

    def _make_folder(self, whole: bool) -> Path:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if not whole:
            self.path.mkdir()
            return self.path
        folder = temporary_name(self.path)
        folder.mkdir()
        return folder

    @property
    def folder(self) -> Path:
        """The folder of the files until the bag is closed; a temporary one if ``whole``."""
        return self._folder

    @property
    def counts(self) -> dict[str, int]:
        """Messages written, by topic."""
        return {name: channel.info.count for name, channel in self._channels.items()}

    @property
    def size(self) -> int:
        """Bytes in the current file."""
        return self._file.size

    def add_topic(
        self,
        name: str,
        type_name: str,
        *,
        qos: Sequence[Qos] = (),
        definition: str | None = None,
        type_hash: str | None = None,
    ) -> None:
        """Register a topic of CDR messages; no effect if it is already registered with this type.

        ``definition`` and ``type_hash`` are for types that are not ROS 2 Jazzy's standard ones. Raises InputError if
        the type is unknown, or if the topic is registered with another type.
        """
        if (known := self._channels.get(name)) is not None:
            if known.info.type != type_name:
                raise InputError(f"{self._final}: topic {name} has type {known.info.type}, not {type_name}")
            return
        text = interfaces.definition(type_name) if definition is None else definition
        self.add_interface(
            name,
            Interface(
                type_name,
                hash=interfaces.type_hash(type_name) if type_hash is None else type_hash,
                schema=Schema(id=0, name=type_name, encoding=ROS2MSG, data=text.encode()),
            ),
            qos,
        )

    def add_interface(self, name: str, interface: Interface, qos: Sequence[Qos]) -> None:
        """Register a new topic with the message type as another bag has it."""
        channel = _Channel(metadata.TopicInfo(name, interface, tuple(qos)))
        self._register(channel)
        self._channels[name] = channel
        self.info.topics.append(channel.info)
        self._write_metadata()

    def write(
        self,
        topic: Topic | str,
        cdr: bytes | memoryview,
        log_time_ns: int,
        publish_time_ns: int | None = None,
        sequence: int = 0,
    ) -> None:
        """Append one CDR message; a ``Topic`` registers itself, a name must have been added."""
        name = topic if isinstance(topic, str) else topic.name
        if (channel := self._channels.get(name)) is None:
            if isinstance(topic, str):
                raise InputError(f"{self._final}: topic {topic} was not added, its type is not known")
            self.add_topic(name, topic.type, qos=[metadata.qos(latched=topic.latched, depth=topic.depth)])
            channel = self._channels[name]
        if not 0 <= log_time_ns < 1 << 63:
            raise InputError(f"{self._final}: topic {name}: log time {log_time_ns} ns is not a time since 1970")
        self._flush_or_split(log_time_ns)
        # Counted before it is written: if the disk is full, the discarded chunk includes this message.
        channel.info.count += 1
        current = self.info.files[-1]
        current.start_ns = min(current.start_ns, log_time_ns) if current.count else log_time_ns
        current.end_ns = max(current.end_ns, log_time_ns)
        current.count += 1
        publish_time_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        self._file.add_message(channel.id, log_time_ns, publish_time_ns, cdr, sequence)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write an MCAP metadata record, such as ``trial`` with the provenance."""
        # A lone surrogate, which the JSON of /trial may hold but UTF-8 may not, is written as its JSON escape.
        texts = {key: str(value).encode("utf-8", "backslashreplace").decode() for key, value in values.items()}
        self._file.add_metadata(name, texts)

    def attach(self, name: str, data: bytes, media_type: str) -> None:
        """Write an attachment, such as campaign.yaml."""
        self._file.add_attachment(name, data, media_type, self.info.files[-1].end_ns)

    def flush(self) -> None:
        """Write everything so far to the file. Raises InputError if the bag was renamed or deleted meanwhile."""
        self._file.flush(fsync=self._fsync)
        self._check_place()

    def _check_place(self) -> None:
        # Writing itself goes on without an error, and metadata.yaml would get a new folder of the old name.
        if not self._file.is_at(self._folder / self.info.files[-1].path):
            raise InputError(f"{self._final}: renamed or deleted while it was written")

    def close(self) -> None:
        """Complete the file and metadata.yaml, sync to disk and rename the folder to its final name.

        Raises InputError if the bag was renamed or deleted meanwhile; its file is complete, wherever it is.
        """
        if self._closed:
            return
        self._file.close()
        self._check_place()
        self.info.custom["state"] = metadata.COMPLETE
        metadata.write(self._folder, self.info)
        for path in (*self._folder.iterdir(), self._folder):
            sync(path)
        self._closed = True
        if self._folder == self._final:
            return
        try:
            self._folder.rename(self._final)
        except OSError:
            self.abandon()
            raise InputError(f"{self._final}: exists already, not overwriting") from None
        sync(self._final.parent)

    def close_short(self, last_records: Callable[[], Mapping[str, Mapping[str, str]]]) -> None:
        """Close on a full disk: discard as many of the last chunks as needed to make room for the summary.

        ``last_records`` returns the final metadata records; it is called when ``counts`` are up to date.
        Raises OSError if not even an empty file fits.
        """
        drop = self._file.drop_torn
        while True:
            dropped = drop()
            drop = self._file.drop_last_chunk
            for channel in self._channels.values():
                channel.info.count -= dropped.get(channel.id, 0)
            current = self.info.files[-1]
            current.count, (current.start_ns, current.end_ns) = self._file.count, self._file.span
            try:
                for name, values in last_records().items():
                    self.metadata(name, values)
                self.close()
                return
            except OSError:
                if not self._file.can_drop:
                    raise

    def abandon(self) -> None:
        """Stop without completing: a ``whole`` bag is deleted, any other stays and can be recovered."""
        self._closed = True
        self._file.abandon()
        if self._folder != self._final:
            shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and self._folder != self._final:
            self.abandon()
            return
        try:
            self.close()
        except BaseException:
            self.abandon()
            raise

    def _flush_or_split(self, log_time_ns: int) -> None:
        """Flush, and begin a new file, if due at the time of the next message."""
        if self._flushed_ns is None:
            self._flushed_ns = log_time_ns
        if self._flush_ns and log_time_ns - self._flushed_ns >= self._flush_ns:
            self.flush()
            self._flushed_ns = log_time_ns
        current = self.info.files[-1]
        full = self._split.size and self._file.size >= self._split.size
        old = self._split.seconds and log_time_ns - current.start_ns >= self._split.seconds * SECOND_NS
        if current.count and (full or old):
            self._file.close()
            self._open_file()

    def _open_file(self) -> None:
        name = f"{self._final.name}_{len(self.info.files)}.mcap"
        try:
            self._file = McapWriter(self._folder / name, **self._storage)
            self.info.files.append(metadata.FileInfo(name))
            for channel in self._channels.values():
                self._register(channel)
            self._write_metadata()
        except BaseException:
            if self._folder != self._final:
                shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def _write_metadata(self) -> None:
        """Update metadata.yaml before the messages, unless a crash would leave no folder anyway."""
        if self._folder == self._final:
            self._check_place()
            metadata.write(self._folder, self.info)

    def _register(self, channel: _Channel) -> None:
        info, interface = channel.info, channel.info.interface
        about = {"offered_qos_profiles": metadata.qos_text(info.qos), "topic_type_hash": interface.hash}
        channel.id = self._file.add_channel(info.name, interface.encoding, interface.schema, about)
