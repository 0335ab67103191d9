"""Bag: a bag recorded by this project, `ros2 bag`, rosbags or any MCAP writer. No ROS needed.

bag = Bag.open(Path("runs/demo/trials/t0001"))
bag.topics["/speed"].count, bag.start_ns, bag.provenance["trial"]
legs = bag.columns("/leg_states", "position", "velocity")
for message in bag.messages(["/trial"]): message.decode()
"""

import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, Metadata, Schema
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_common.terminal import counted
from sandbot_record.bags import columns, foreign, mcap_scan, metadata, video
from sandbot_record.bags.definitions import Definitions
from sandbot_record.bags.file_bytes import FileBytes
from sandbot_record.bags.interfaces import JAZZY, Interface
from sandbot_record.bags.mcap_scan import Batch, Damage

Part = tuple[Batch, NDArray[np.int64]]
"""A block and the indices of some of its rows."""
_KEEP_BYTES = 32 << 20
"""Bags up to this size (uncompressed) stay in memory once scanned; larger ones are scanned again each time."""

_STORAGE = (".mcap", ".db3")
FIELD_STAMP = ("header.stamp.sec", "header.stamp.nanosec")


@dataclass(frozen=True)
class Message:
    """One message as it was recorded."""

    topic: str
    interface: Interface = field(repr=False)
    log_time_ns: int
    publish_time_ns: int
    sequence: int
    data: memoryview = field(repr=False)

    @property
    def type(self) -> str:
        """Name of its type, such as ``sensor_msgs/msg/JointState``."""
        return self.interface.type

    def decode(self) -> Any:
        """The message with its fields. Raises InputError if the bytes are not a message of this type, or not CDR."""
        return self.interface.decode(bytes(self.data))


@dataclass(frozen=True)
class Columns:
    """The messages of one topic in order of log time: times (n,) in ns and the requested fields, (n,) or (n, k)."""

    log_time_ns: NDArray[np.int64]
    publish_time_ns: NDArray[np.int64]
    fields: dict[str, NDArray[Any]]

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.fields[name]

    @property
    def stamp_ns(self) -> NDArray[np.int64]:
        """The header stamps; the fields ``FIELD_STAMP`` must have been requested."""
        seconds, nanoseconds = (self.fields[name].astype(np.int64) for name in FIELD_STAMP)
        return seconds * 1_000_000_000 + nanoseconds


@dataclass
class Bag:
    """A bag; create it with ``Bag.open``. ``complete``: properly closed; ``problems``: one line each, empty if none.

    ``miscounts`` are those problems where the number of messages is wrong although no damage was found.
    """

    path: Path
    files: list[Path]
    info: metadata.BagInfo | None
    topics: dict[str, metadata.TopicInfo]
    complete: bool
    start_ns: int
    end_ns: int
    provenance: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    problems: list[str]
    miscounts: list[str] = field(default_factory=list)
    _kept: list[tuple[int, mcap_scan.Item, Definitions]] | None = None
    _places: dict[str, list[Part]] | None = None

    @classmethod
    def open(cls, path: Path, *, strict: bool = True) -> "Bag":
        """Read a bag's folder (or a single .mcap or .db3 file) once: counts, times, provenance, problems.

        Raises InputError if there is no bag or, if ``strict``, if it is unfinished or damaged (the error suggests
        `recover`).
        """
        folder, files, info = locate(path)
        bag = cls(folder, files, info, {}, True, 0, 0, {}, {}, [])
        bag._survey()
        if strict and bag.problems:
            raise InputError(f"{path}: {bag.problems[0]}; {bag.remedy}")
        return bag

    @property
    def remedy(self) -> str:
        """What to do if there are problems."""
        recover = f"bring back what is intact with: trackway recover {self.path} NEW_BAG"
        return recover if self.count else "no message can be brought back"

    @property
    def count(self) -> int:
        """Messages in all topics."""
        return sum(topic.count for topic in self.topics.values())

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Messages in file order, of the given topics or of all."""
        for batch, definitions in self.batches():
            names = {
                channel: topic
                for channel, topic in definitions.topics.items()
                if topics is None or topic.name in topics
            }
            fields = (batch.rows[name].tolist() for name in ("channel", "log_time_ns", "publish_time_ns", "sequence"))
            view = memoryview(batch.data)
            rows = zip(*fields, batch.at.tolist(), batch.length.tolist(), strict=True)
            for channel, log_time, publish_time, sequence, at, length in rows:
                if (topic := names.get(channel)) is not None:
                    data = view[at : at + length]
                    yield Message(topic.name, topic.interface, log_time, publish_time, sequence, data)

    def check_topic(self, topic: str) -> None:
        """Raise InputError if there is no such topic."""
        if topic not in self.topics:
            raise InputError(f"{self.path}: no topic {topic}; there are: {', '.join(self.topics)}")

    def columns(self, topic: str, *names: str) -> Columns:
        """Numeric fields of all messages of a topic. Raises InputError if there is no such topic or field."""
        self.check_topic(topic)
        parts = self._parts(topic)
        log, publish = (
            np.concatenate([np.empty(0, np.int64), *(batch.rows[name][rows] for batch, rows in parts)])
            for name in ("log_time_ns", "publish_time_ns")
        )
        try:
            values = _fields(parts, self.topics[topic].interface, names)
        except InputError as error:
            raise InputError(f"{self.path}: topic {topic}: {error}") from None
        order = np.argsort(log, kind="stable")
        if (np.diff(order) == 1).all():
            return Columns(log, publish, values)
        return Columns(log[order], publish[order], {name: value[order] for name, value in values.items()})

    def _parts(self, topic: str) -> list[Part]:
        """The blocks with messages of a topic, and the rows of these; cached for a small bag."""
        if self._kept is None:
            found = ((batch, _rows(batch, definitions, topic)) for batch, definitions in self.batches())
            return [_alone(batch, rows) for batch, rows in found if len(rows)]
        if self._places is None:
            self._places = _by_topic(self.batches())
        return self._places.get(topic, [])

    @property
    def videos(self) -> dict[str, Path]:
        """The video file of each frame index topic (``sandbot_record.bags.video``)."""
        folder = self.path if self.path.is_dir() else self.path.parent
        found = {name: video.image_topic(topic) for name, topic in self.topics.items()}
        return {name: folder / video.file_name(image) for name, image in found.items() if image is not None}

    def batches(self) -> Iterator[tuple[Batch, Definitions]]:
        """The intact blocks of all files, each with the definitions so far."""
        for _, batch, definitions in self.blocks():
            yield batch, definitions

    def blocks(self) -> Iterator[tuple[int, Batch, Definitions]]:
        """The same, each with the number of its file."""
        for file, item, definitions in self.items():
            if isinstance(item, Batch):
                yield file, item, definitions

    def items(self) -> Iterator[tuple[int, mcap_scan.Item, Definitions]]:
        """Everything in all files in order, including damage: (number of the file, item, definitions so far)."""
        if self._kept is not None:
            yield from self._kept
        elif foreign.is_foreign(self.files[0], self.info):
            found = foreign.items(self.path, self.files, Definitions(_release(self.info)))
            yield from ((0, batch, definitions) for batch, definitions in found)
        else:
            for file, path in enumerate(self.files):
                yield from ((file, item, definitions) for item, definitions in _file_items(path, self.info))

    def _survey(self) -> None:
        starts: list[int] = []
        ends: list[int] = []
        counts: dict[str, int] = {}
        seen: dict[str, metadata.TopicInfo] = {}
        found = dict.fromkeys(range(len(self.files)), 0)
        self._kept = self._small()
        for file, item, definitions in self.items():
            self._note(item)
            if isinstance(item, Damage):
                found.pop(file, None)  # the damage already explains missing messages
            elif isinstance(item, Batch) and len(item.rows):
                if file in found:
                    found[file] += len(item.rows)
                starts.append(int(item.rows["log_time_ns"].min()))
                ends.append(int(item.rows["log_time_ns"].max()))
                self._count(item, definitions, counts)
            for topic in definitions.topics.values():
                if topic.name not in seen or seen[topic.name].interface.schema is None:
                    seen[topic.name] = topic
        known = {topic.name: topic for topic in self.info.topics} if self.info else {}
        for name, topic in (known | seen).items():
            whole = known.get(name, topic)
            own, listed = topic.interface, whole.interface
            interface = own if own.type else replace(own, type=listed.type, hash=listed.hash)
            self.topics[name] = metadata.TopicInfo(name, interface, whole.qos or topic.qos, counts.get(name, 0))
        if starts:
            self.start_ns, self.end_ns = min(starts), max(ends)
        self._check_complete()
        self._check_counts(found)
        self.problems += [
            f"{file.name} is missing, the frames of {name}"
            for name, file in self.videos.items()
            if self.topics[name].count and not file.is_file()
        ]

    def _small(self) -> list[tuple[int, mcap_scan.Item, Definitions]] | None:
        """Everything in the bag, or None if that is more than ``_KEEP_BYTES`` when decompressed."""
        items, size = [], 0
        for entry in self.items():
            size += len(entry[1].data) if isinstance(entry[1], Batch | Attachment) else 0
            if size > _KEEP_BYTES:
                return None
            items.append(entry)
        return items

    def _note(self, item: mcap_scan.Item) -> None:
        if isinstance(item, Damage):
            self.problems.append(f"damaged: {item.reason} at byte {item.start}")
        elif isinstance(item, Metadata):
            self.provenance[item.name] = dict(item.metadata)
        elif isinstance(item, Attachment):
            self.attachments[item.name] = item.data

    def _count(self, batch: Batch, definitions: Definitions, counts: dict[str, int]) -> None:
        channels, numbers = np.unique(batch.rows["channel"], return_counts=True)
        for channel, number in zip(channels.tolist(), numbers.tolist(), strict=True):
            topic = definitions.topics.get(channel)
            if topic is None:
                self.problems.append(f"damaged: {counted(number, 'message')} of unknown channel {channel}")
            else:
                counts[topic.name] = counts.get(topic.name, 0) + number

    def _check_complete(self) -> None:
        for path in self.files:
            data = FileBytes(path)
            if path.suffix == ".mcap" and not mcap_scan.finished(data):
                self.complete = False
                cut = mcap_scan.MAGIC.startswith(bytes(data[: len(mcap_scan.MAGIC)]))
                what = "is unfinished, its recording was cut off" if cut else "neither begins nor ends as an MCAP file"
                self.problems.insert(0, f"{path.name} {what}")
        if self.info is not None and self.complete and self.info.custom.get("state") == metadata.RECORDING:
            self.complete = False
            self.problems.insert(0, "metadata.yaml is unfinished, the recording was cut off")

    def _check_counts(self, found: Mapping[int, int]) -> None:
        """Compare counts: a flipped bit can turn a message into another kind of record, which shows only as a missing
        message. ``found``: messages in each file without other damage.
        """
        if self.info is not None and not self.problems and self.info.count != self.count:
            stated_in_all = counted(self.info.count, "message")
            self.miscounts.append(f"metadata.yaml says {stated_in_all}, the files hold {self.count}")
        if not foreign.is_foreign(self.files[0], self.info):
            for file, number in found.items():
                stated = mcap_scan.stated_count(FileBytes(self.files[file]))
                if stated not in (None, number):
                    name = self.files[file].name
                    self.miscounts.append(f"{name}: its summary says {counted(stated, 'message')}, it holds {number}")
        self.problems += self.miscounts


def read(bag: Path | str, *topics: str) -> Iterator[tuple[int, Message]]:
    """The messages of a bag in file order, of the given topics or of all: (log time in ns since 1970, message).

    A message has ``topic`` and ``type``; ``decode()`` gives its fields. Raises InputError if there is no such bag
    or topic, or if the bag is unfinished or damaged (``Bag.open`` with ``strict=False`` reads what is intact).

    >>> import sandbot_record
    >>> for stamp_ns, message in sandbot_record.read("trial", "/trial"):
    ...     print(message.topic, message.type, message.decode().data[:12])
    /trial std_msgs/msg/String {"trial_id":
    """
    opened = Bag.open(Path(bag))
    for name in topics:
        opened.check_topic(name)
    return ((message.log_time_ns, message) for message in opened.messages(topics or None))


def locate(path: Path) -> tuple[Path, list[Path], metadata.BagInfo | None]:
    """The folder (or file), storage files in order and metadata of a bag. Raises InputError if it is not one."""
    if path.is_file() and path.suffix in _STORAGE:
        return path, [path], None
    if not path.exists():
        raise InputError(f"{path}: no such bag")
    if not path.is_dir():
        raise InputError(f"{path}: not a bag: neither a folder nor a .mcap or .db3 file")
    found = storage_files(path)
    try:
        info = metadata.read(path)
    except InputError:
        if not found:
            raise
        info = None
    if info is not None:
        named = [path / Path(file.path).name for file in info.files]
        if missing := [file.name for file in named if not file.is_file()]:
            raise InputError(f"{path}: {missing[0]}, named in metadata.yaml, is missing")
        files = named + _later_splits(path, named, found, info)
        if not files:
            raise InputError(f"{path}: not a bag: its metadata.yaml names no storage file")
        return path, files, info
    if not found:
        if (path / "trials").is_dir():
            raise InputError(f"{path}: not a bag but a campaign folder: its bags are in {path / 'trials'}")
        raise InputError(f"{path}: not a bag: no metadata.yaml and no .mcap or .db3 file in it")
    if not _of_one_bag(found):
        raise InputError(
            f"{path}: not one bag but a folder of several, {found[0].name} and {found[1].name}: give one of them"
        )
    # A bag converted in place has both .db3 and .mcap files: the .mcap files are the result.
    return path, [file for file in found if file.suffix == ".mcap"] or found, None


def is_bag(path: Path) -> bool:
    """Whether the path looks like a bag."""
    if path.is_file():
        return path.suffix in _STORAGE
    # Path.is_file would raise an error for a folder that may not be entered.
    return os.path.isfile(path / metadata.NAME) or _of_one_bag(storage_files(path))


def storage_files(folder: Path) -> list[Path]:
    """The storage files in a folder, splits in order; hidden files, such as those macOS adds, are ignored."""
    found = [file for file in folder.glob("[!.]*") if file.suffix in _STORAGE and file.is_file()]
    return sorted(found, key=lambda file: (_split(file)[1], file.name))


def _split(file: Path) -> tuple[str, int]:
    """Bag name and split number of a file such as ``NAME_0.mcap``; -1 if it has no number."""
    name, _, number = file.stem.rpartition("_")
    return (name, int(number)) if name and number.isdecimal() else (file.stem, -1)


def _of_one_bag(files: Sequence[Path]) -> bool:
    """Whether storage files without metadata.yaml are one bag: a single file, or splits of one name from 0 on.

    Otherwise each file is its own bag, as in a folder of trials recorded into one file each.
    """
    names = {_split(file)[0] for file in files}
    return len(names) == 1 and (len({file.stem for file in files}) == 1 or _split(files[0])[1] == 0)


def _later_splits(folder: Path, named: Sequence[Path], found: Sequence[Path], info: metadata.BagInfo) -> list[Path]:
    """Splits missing from metadata.yaml because the recording was cut off before it was updated; else none."""
    if info.custom.get("state") != metadata.RECORDING:
        return []
    name, last = _split(named[-1]) if named else (folder.name, -1)
    return [file for file in found if file.suffix == ".mcap" and _split(file)[0] == name and _split(file)[1] > last]


def _file_items(path: Path, info: metadata.BagInfo | None) -> Iterator[tuple[mcap_scan.Item, Definitions]]:
    data = FileBytes(path)
    definitions = _initial_definitions(data, info)
    for item in mcap_scan.scan(data):
        if isinstance(item, Schema | Channel):
            definitions.learn(item)
        elif isinstance(item, Batch):
            for record in item.definitions:
                definitions.learn(record)
        yield item, definitions


def _initial_definitions(data: FileBytes, info: metadata.BagInfo | None) -> Definitions:
    """Definitions from the most trustworthy source: the summary (it has a CRC), else our metadata.yaml."""
    definitions = Definitions(_release(info))
    records = mcap_scan.summary(data) or []
    for kind in (Schema, Channel):
        for record in records:
            if isinstance(record, kind):
                definitions.learn(record)
    if not definitions.topics and info is not None and "state" in info.custom:
        # Our writer numbers the channels of every file in the order of metadata.yaml.
        definitions.topics.update(enumerate(info.topics, start=1))
    return definitions


def _release(info: metadata.BagInfo | None) -> str:
    return info.release if info is not None else JAZZY


def _by_topic(batches: Iterable[tuple[Batch, Definitions]]) -> dict[str, list[Part]]:
    """Blocks and rows of each topic, in file order."""
    found: dict[str, list[Part]] = {}
    for batch, definitions in batches:
        present = np.unique(batch.rows["channel"]).tolist()
        for name in dict.fromkeys(definitions.topics[n].name for n in present if n in definitions.topics):
            found.setdefault(name, []).append((batch, _rows(batch, definitions, name)))
    return found


def _rows(batch: Batch, definitions: Definitions, topic: str) -> NDArray[np.int64]:
    """The rows of a block that belong to a topic, which may have several channels."""
    own = [channel for channel, info in definitions.topics.items() if info.name == topic]
    channels = batch.rows["channel"]
    # Nearly always one channel, and np.isin costs ten times as much as ==.
    return np.flatnonzero(channels == own[0] if len(own) == 1 else np.isin(channels, own))


def _alone(batch: Batch, rows: NDArray[np.int64]) -> Part:
    """A block of these rows only: the others of a large bag, such as frames, would fill the memory."""
    length = batch.length[rows]
    data = b"".join(batch.payload(row) for row in rows.tolist())
    return replace(batch, data=data, rows=batch.rows[rows], at=np.cumsum(length) - length, length=length), np.arange(
        len(rows)
    )


def _fields(parts: list[Part], interface: Interface, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """The fields of all messages, extracted at once for each message length."""
    if not parts or not names:
        return {name: np.empty(0) for name in names}
    lengths = np.concatenate([batch.length[rows] for batch, rows in parts])
    result: dict[str, NDArray[Any]] = {}
    for length in np.unique(lengths).tolist():
        where = np.flatnonzero(lengths == length)
        for name, values in columns.gather(_stacked(parts, length), interface, names).items():
            if name not in result:
                result[name] = np.empty((len(lengths), *values.shape[1:]), values.dtype)
            if result[name].shape[1:] != values.shape[1:]:
                raise InputError(f"field {name} does not have the same number of values in all messages")
            result[name][where] = values
    return result


def _stacked(parts: list[tuple[Batch, NDArray[np.int64]]], length: int) -> columns.Bytes:
    """All messages of one length as rows of bytes."""
    picked = []
    for batch, rows in parts:
        at = batch.at[rows[batch.length[rows] == length]]
        if not at.size:  # such a batch may be shorter than the window
            continue
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(batch.data, np.uint8), length)
        picked.append(windows[at])
    return np.concatenate(picked)
