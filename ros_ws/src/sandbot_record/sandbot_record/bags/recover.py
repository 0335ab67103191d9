"""Copies everything intact in a truncated or damaged bag to a new, complete one, and reports what is lost."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from mcap.records import Attachment, Metadata

from sandbot_common.errors import InputError
from sandbot_common.terminal import counted
from sandbot_record.bags import mcap_scan
from sandbot_record.bags.definitions import Definitions
from sandbot_record.bags.interfaces import CDR
from sandbot_record.bags.mcap_scan import Batch, Damage
from sandbot_record.bags.mcap_writer import ROS2
from sandbot_record.bags.metadata import TopicInfo
from sandbot_record.bags.reader import Bag, mapped
from sandbot_record.bags.video import Transfer
from sandbot_record.bags.writer import BagWriter

RECORD = "recovery"
"""Name of the MCAP metadata record a recovered bag carries."""


@dataclass
class Loss:
    """Known losses of one topic; times in ns."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def add(self, count: int, first_ns: int, last_ns: int) -> None:
        """Add messages between two times."""
        self.first_ns = min(self.first_ns, first_ns) if self.count else first_ns
        self.last_ns = max(self.last_ns, last_ns)
        self.count += count


@dataclass
class Recovery:
    """What was recovered and what was lost. ``notes``: one line for each damaged part with unknown content."""

    counts: dict[str, int] = field(default_factory=dict)
    losses: dict[str, Loss] = field(default_factory=lambda: defaultdict(Loss))
    notes: list[str] = field(default_factory=list)

    @property
    def lossless(self) -> bool:
        """Whether nothing is known to be lost."""
        return not self.losses and not self.notes

    def lines(self) -> list[str]:
        """One line for each topic, each known loss and each note."""
        lines = [f"{name}: {counted(count, 'message')} back" for name, count in self.counts.items()]
        lines += [
            f"lost: {name}: {counted(loss.count, 'message')} from {_clock(loss.first_ns)} to {_clock(loss.last_ns)}"
            for name, loss in self.losses.items()
        ]
        return lines + [f"lost: {note}" for note in self.notes]


def recover(source: Path, target: Path) -> Recovery:
    """Write everything intact in ``source`` to the new bag ``target``.

    Raises InputError if ``source`` is no bag, if nothing in it can be recovered, or if ``target`` exists.
    """
    bag = Bag.open(source, strict=False)
    if not bag.count:
        reason = bag.problems[0] if bag.problems else "it is empty"
        raise InputError(f"{source}: no message can be brought back: {reason}")
    result = Recovery()
    # The ROS 2 profile requires CDR.
    all_cdr = all(topic.interface.encoding == CDR for topic in bag.topics.values())
    with BagWriter(target, profile=ROS2 if all_cdr else "") as writer:
        films = {name: Transfer(file, writer.folder) for name, file in bag.videos.items()}
        last_ns = bag.start_ns
        for file, item, definitions in bag.items():
            if isinstance(item, Batch):
                _copy(item, definitions, bag, writer, films, result)
                last_ns = int(item.rows["log_time_ns"][-1]) if len(item.rows) else last_ns
            elif isinstance(item, Damage):
                _count_lost(item, definitions, result, f"{bag.files[file].name}", last_ns)
            elif isinstance(item, Metadata) and item.name != "rosbag2":
                writer.metadata(item.name, item.metadata)
            elif isinstance(item, Attachment):
                writer.attach(item.name, item.data, item.media_type)
        for film in films.values():
            film.close()
        for topic in bag.topics.values():
            _register(topic, bag, writer)
        result.counts = writer.counts
        if not result.counts or not sum(result.counts.values()):
            raise InputError(f"{source}: no message can be brought back: none is of a type that is known")
        _note_cut(bag, result)
        result.notes += bag.miscounts
        writer.metadata(
            RECORD, {"source": source.name, "lost": "\n".join(result.lines()[len(result.counts) :]) or "nothing"}
        )
    return result


def _copy(
    batch: Batch, definitions: Definitions, bag: Bag, writer: BagWriter, films: Mapping[str, Transfer], result: Recovery
) -> None:
    topics: dict[int, TopicInfo | None] = {}
    for row, fields in enumerate(batch.rows):
        channel, log_time = int(fields["channel"]), int(fields["log_time_ns"])
        if channel not in topics:
            known = definitions.topics.get(channel)
            topics[channel] = known if known and _register(known, bag, writer) else None
        topic = topics[channel]
        if topic is None:
            result.losses[f"channel {channel} (topic or type not known)"].add(1, log_time, log_time)
            continue
        sound = log_time >= 0 and (batch.checked or _decodes(batch, row, topic))
        data = _with_frame(batch.payload(row), films.get(topic.name)) if sound else None
        if data is None:
            result.losses[topic.name].add(1, log_time, log_time)
        else:
            publish_time = max(0, int(fields["publish_time_ns"]))
            writer.write(topic.name, data, log_time, publish_time, int(fields["sequence"]))


def _with_frame(data: memoryview, film: Transfer | None) -> bytes | memoryview | None:
    """The message unchanged, or a frame index after copying its frame; None if the frame is lost."""
    try:
        return data if film is None else film(data)
    except InputError:
        return None


def _register(topic: TopicInfo, bag: Bag, writer: BagWriter) -> bool:
    """Register a topic in the new bag; False if its message type is unknown."""
    if topic.name in writer.counts:
        return True
    interface = topic.interface.described()
    if interface.encoding == CDR and interface.schema is None:
        return False
    writer.add_interface(topic.name, interface, topic.qos or bag.topics[topic.name].qos)
    return True


def _decodes(batch: Batch, row: int, topic: TopicInfo) -> bool:
    """Whether a message without a CRC can at least be decoded as its type (True if the type is unknown)."""
    if not topic.interface.known:
        return True
    try:
        topic.interface.decode(bytes(batch.payload(row)))
    except InputError:
        return False
    return True


def _count_lost(damage: Damage, definitions: Definitions, result: Recovery, file: str, last_ns: int) -> None:
    for lost in damage.lost:
        topic = definitions.topics.get(lost.channel)
        result.losses[topic.name if topic else f"channel {lost.channel}"].add(lost.count, lost.first_ns, lost.last_ns)
    if not damage.lost:
        size = counted(damage.end - damage.start, "byte")
        result.notes.append(f"{file}: {size} at byte {damage.start} ({damage.reason}), after {_clock(last_ns)}")


def _note_cut(bag: Bag, result: Recovery) -> None:
    for path in bag.files:
        if path.suffix == ".mcap" and not mcap_scan.finished(mapped(path)):
            result.notes.append(f"{path.name}: what came after {_clock(bag.end_ns)} and was not flushed yet")


def _clock(t_ns: int) -> str:
    return f"{datetime.fromtimestamp(t_ns / 1e9, UTC):%H:%M:%S.%f} UTC" if t_ns < 1 << 62 else f"{t_ns} ns"
