"""The replay without ROS: a bag's messages in order of log time, and when each is due on the player's clock."""

from bisect import bisect_left
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import QosDurability

from sandbot_common.errors import InputError
from sandbot_record.bags import foreign, frames, mcap_scan, metadata, video
from sandbot_record.bags.file_bytes import FileBytes, FileLost
from sandbot_record.bags.interfaces import Interface
from sandbot_record.bags.mcap_scan import Batch
from sandbot_record.bags.reader import Bag, Message
from sandbot_record.bags.translate import to_jazzy
from sandbot_record.bags.video import VideoFrames

SECOND_NS = 1_000_000_000
_KEPT_BLOCKS = 16


class Timeline:
    """The messages of some topics of a bag in order of log time; only an index and a few blocks are held in memory.

    Frames recorded as video are returned as raw images on their original topic, and so are JPEG messages with
    ``decode_jpeg``.
    """

    def __init__(self, bag: Bag, topics: Collection[str] | None = None, *, decode_jpeg: bool = False) -> None:
        shown = {name: _shown(info, decode_jpeg=decode_jpeg) for name, info in bag.topics.items()}
        there = [info.name for info in shown.values()]
        if topics is not None and (unknown := [name for name in topics if name not in there]):
            raise InputError(f"{bag.path}: no topic {unknown[0]}; there are: {', '.join(there)}")
        wanted = {name: info for name, info in shown.items() if topics is None or info.name in topics}
        _check_all_cdr(bag.path, wanted.values())
        self.topics = {info.name: info for info in wanted.values()}
        self._names = list(wanted)
        self._shown = list(wanted.values())
        self._videos = {shown[name].name: VideoFrames(file) for name, file in bag.videos.items()}
        self.decoded = [info.name for name, info in wanted.items() if info.name not in (name, *self._videos)]
        """The topics of JPEG messages that are played as raw images."""
        # What rosbags reads can't be fetched again block by block, so it stays in memory.
        self._kept: list[Batch] | None = [] if foreign.is_foreign(bag.files[0], bag.info) else None
        self._files = [] if self._kept is not None else [FileBytes(path) for path in bag.files]
        self._blocks: list[tuple[int, int, int]] = []
        """File, offset and number of messages of each block."""
        times, blocks, rows, names = self._index(bag)
        if not len(times):
            raise InputError(
                f"{bag.path}: nothing to replay: no messages{'' if topics is None else ' on these topics'}"
            )
        self.start_ns, self.end_ns = bag.start_ns, bag.end_ns
        order = np.argsort(times, kind="stable")
        self.times_ns: NDArray[np.int64] = times[order]
        self._block, self._row, self._topic = blocks[order], rows[order], names[order]
        self._load = lru_cache(_KEPT_BLOCKS)(self._batch)

    def __len__(self) -> int:
        return len(self.times_ns)

    def __getitem__(self, index: int) -> Message:
        """Message ``index``. Raises InputError for a frame that is missing from its video, FileLost if the bag is."""
        batch = self._load(int(self._block[index]))
        row = int(self._row[index])
        topic = self._shown[self._topic[index]]
        fields = batch.rows[row]
        data = batch.payload(row)
        if (film := self._videos.get(topic.name)) is not None:
            place = video.place(data)
            data = memoryview(frames.to_image(place.header, film.frame(place)))
        elif topic.name != self._names[self._topic[index]]:
            data = memoryview(frames.from_jpeg(data))
        else:
            data = to_jazzy(data, topic.interface)
        return Message(
            topic.name,
            topic.interface,
            int(fields["log_time_ns"]),
            int(fields["publish_time_ns"]),
            int(fields["sequence"]),
            data,
        )

    def last_before(self, index: int, topic: str) -> int | None:
        """The index of a topic's last message before ``index``; None if there is none."""
        number = [info.name for info in self._shown].index(topic)
        places = np.flatnonzero(self._topic[:index] == number)
        return int(places[-1]) if places.size else None

    def _batch(self, block: int) -> Batch:
        if self._kept is not None:
            return self._kept[block]
        file, offset, count = self._blocks[block]
        batch = mcap_scan.batch_at(self._files[file], offset)
        if batch is None or len(batch.rows) != count:
            raise FileLost(f"{self._files[file].path}: was overwritten at byte {offset} while it was read")
        return batch

    def _index(self, bag: Bag) -> tuple[NDArray[np.int64], ...]:
        columns: list[list[NDArray[np.int64]]] = [[np.empty(0, np.int64)] for _ in range(4)]
        for file, batch, definitions in bag.blocks():
            number = {
                channel: self._names.index(info.name)
                for channel, info in definitions.topics.items()
                if info.name in self._names
            }
            rows = np.flatnonzero(np.isin(batch.rows["channel"], list(number)))
            if not len(rows):
                continue
            channels = batch.rows["channel"][rows]
            topic = np.array([number[channel] for channel in channels.tolist()], dtype=np.int64)
            block = np.full(len(rows), len(self._blocks), dtype=np.int64)
            for column, part in zip(columns, (batch.rows["log_time_ns"][rows], block, rows, topic), strict=True):
                column.append(part.astype(np.int64))
            self._blocks.append((file, batch.offset, len(batch.rows)))
            if self._kept is not None:
                self._kept.append(batch)
        return tuple(np.concatenate(column) for column in columns)


def _check_all_cdr(path: Path, topics: Iterable[metadata.TopicInfo]) -> None:
    for topic in topics:
        try:
            topic.interface.check_cdr()
        except InputError as error:
            raise InputError(f"{path}: topic {topic.name}: {error}; leave it out with --topics") from None


def _is_latched(info: metadata.TopicInfo) -> bool:
    return bool(info.qos) and all(profile.durability == QosDurability.TRANSIENT_LOCAL for profile in info.qos)


def _shown(info: metadata.TopicInfo, *, decode_jpeg: bool) -> metadata.TopicInfo:
    """The topic as it is played: the image topic in place of a video's frame index and, if asked, of JPEG messages."""
    image = video.image_topic(info) or (frames.raw_name(info.name, info.type) if decode_jpeg else None)
    return info if image is None else replace(info, name=image, interface=Interface(frames.RAW))


@dataclass
class Span:
    """The part of the bag to play: indices [first, end) of the timeline and its limits [ns, log time]."""

    first: int
    end: int
    start_ns: int
    end_ns: int


class Player:
    """Decides which messages are due; ``now_ns`` is any monotonic clock of the caller's, in ns.

    ``start_s`` and ``until_s`` count from the bag's first message, played or not, and a loop takes as long as this part
    of the bag; ``rate`` 2 plays twice as fast.
    """

    def __init__(
        self,
        timeline: Timeline,
        *,
        rate: float = 1.0,
        loop: bool = False,
        start_s: float = 0.0,
        until_s: float | None = None,
    ) -> None:
        if not 0 < rate < 1e6:
            raise InputError(f"rate {rate:g}: above 0 is needed")
        self.timeline, self.loop = timeline, loop
        self.span = self._span(start_s, until_s)
        if self.span.first == self.span.end and not self.latched_before_start():
            raise InputError("nothing to replay: no messages on these topics in this part of the bag")
        self.index = self.span.first
        self.rounds = 0
        self.paused = False
        self._rate = rate
        self._anchor: tuple[int, int] | None = None
        """Caller's clock and bag time at the same instant; None until the first step after a change."""
        self._position_ns = self.span.start_ns

    def _span(self, start_s: float, until_s: float | None) -> Span:
        times, begun_ns = self.timeline.times_ns, self.timeline.start_ns
        length_s = (self.timeline.end_ns - begun_ns) / SECOND_NS
        until_s = length_s if until_s is None else until_s
        if not 0 <= start_s <= length_s or not start_s <= until_s:
            raise InputError(
                f"start {start_s:g} s, until {until_s:g} s: the bag has 0 to {length_s:.3f} s, in this order"
            )
        if self.loop and not min(until_s, length_s) > start_s:
            raise InputError("nothing to loop: this part of the bag has no duration")
        start, end = (begun_ns + round(seconds * SECOND_NS) for seconds in (start_s, until_s))
        first, last = int(np.searchsorted(times, start)), int(np.searchsorted(times, end, side="right"))
        return Span(first, last, start, min(end, self.timeline.end_ns))

    @property
    def rate(self) -> float:
        """Playback speed: bag seconds per second."""
        return self._rate

    @property
    def finished(self) -> bool:
        """Whether everything was played; never true when looping."""
        return self.index >= self.span.end and not self.loop

    def position_ns(self, now_ns: int) -> int:
        """Bag time at ``now_ns``."""
        if self._anchor is None or self.paused:
            return self._position_ns
        passed = round((now_ns - self._anchor[0]) * self._rate)
        return min(self._anchor[1] + passed, self.span.end_ns)

    def set_rate(self, rate: float, now_ns: int) -> None:
        """Change the rate from now on."""
        if not 0 < rate < 1e6:
            raise InputError(f"rate {rate:g}: above 0 is needed")
        self._hold(now_ns)
        self._rate = rate

    def pause(self, paused: bool, now_ns: int) -> None:
        """Pause or resume."""
        self._hold(now_ns)
        self.paused = paused

    def seek(self, offset_s: float, now_ns: int) -> None:
        """Go to ``offset_s`` after the bag's first message, clipped to the span. Raises InputError from 1e9 s on."""
        if not abs(offset_s) < 1e9:
            raise InputError(f"position_s {offset_s} is not a number of seconds")
        target = self.timeline.start_ns + round(offset_s * SECOND_NS)
        self._hold(now_ns)
        self._position_ns = min(max(target, self.span.start_ns), self.span.end_ns)
        index = bisect_left(self.timeline.times_ns, self._position_ns)
        self.index = min(max(index, self.span.first), self.span.end)

    def due_ns(self) -> int | None:
        """When, on the caller's clock, the next message or round is due; None if paused or finished."""
        if self.paused or self._anchor is None or self.finished:
            return None
        is_last = self.index >= self.span.end
        ahead = (self.span.end_ns if is_last else int(self.timeline.times_ns[self.index])) - self._anchor[1]
        return self._anchor[0] + round(ahead / self._rate)

    def step(self, now_ns: int) -> Message | None:
        """The next message if it is due by ``now_ns``; when looping, starts again after the last.

        Raises InputError if the next message is a frame missing from its video; the following step skips it. Raises
        FileLost if the bag can no longer be read.
        """
        if self.paused:
            return None
        if self._anchor is None:
            self._anchor = (now_ns, self._position_ns)
        if self.index >= self.span.end and self.loop and self.position_ns(now_ns) >= self.span.end_ns:
            self.rounds += 1
            self.index, self._anchor = self.span.first, (now_ns, self.span.start_ns)
        due = self.due_ns()
        if due is None or due > now_ns or self.index >= self.span.end:
            return None
        self.index += 1
        return self.timeline[self.index - 1]

    def latched_before_start(self) -> list[Message]:
        """The last message of every latched topic before the span: what a late subscriber would have received."""
        latched = [name for name, info in self.timeline.topics.items() if _is_latched(info)]
        last = (self.timeline.last_before(self.span.first, name) for name in latched)
        return [self.timeline[index] for index in sorted(index for index in last if index is not None)]

    def _hold(self, now_ns: int) -> None:
        self._position_ns = self.position_ns(now_ns)
        self._anchor = None
