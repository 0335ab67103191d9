"""The recorder without ROS: messages go into a queue, and a separate thread writes them to the bag.

So a slow disk does not delay receiving. Counts, losses and the reason for stopping are kept here; ``recorder_node``
only feeds it. The clocks are passed in.
"""

import math
import shutil
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from rosbags.interfaces import Qos

from sandbot_common.errors import InputError
from sandbot_common.terminal import counted
from sandbot_record.bags import frames, video
from sandbot_record.bags.video import VideoFile
from sandbot_record.bags.writer import BagWriter

PAUSED, PAUSED_TO_THE_END = "paused", "end"
"""Key in the metadata record ``recording`` for the pauses, "FROM to TO, ..." in log times [ns]; TO may be "end"."""
CLOCK_SET = "clock_set_s"
"""Key there for the steps by which the host's clock was set meanwhile, "+15.000000, ..." [s]; absent without any."""
_BATCH_S = 0.01
"""How long messages are collected before they are written: waking up for each costs more than writing it."""


class Received(NamedTuple):
    """One message as received: ``sequence`` counts what its publisher sent (0: unknown)."""

    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int
    sequence: int


@dataclass
class Tally:
    """What became of a topic's messages."""

    written: int = 0
    gaps: int = 0
    """Missing from the publisher's sequence numbers: sent, never received."""
    reported: int = 0
    """Reported lost by the middleware."""
    dropped: int = 0
    """Received, but not written because the queue or the disk was full."""
    sequence: int = 0

    def count(self, sequence: int) -> None:
        """Count a message by its publisher's sequence number; 0: unknown, or several publishers number separately."""
        if not sequence:
            self.gaps = self.lost
        elif self.sequence:
            self.gaps += max(0, sequence - self.sequence - 1)
            # On a busy machine the middleware also reports messages sent before matching; trust the numbers instead.
            self.reported = min(self.reported, self.gaps)
        self.sequence = sequence

    @property
    def lost(self) -> int:
        """Sent but never received: the larger of the two counts, which overlap and are each incomplete."""
        return max(self.gaps, self.reported)


@dataclass(frozen=True)
class Limits:
    """When recording stops on its own: free space [bytes] below ``min_free``, or after ``duration_s`` (0: never).

    ``queue_bytes``: queue size above which messages are dropped (and counted).
    """

    min_free: int = 200 << 20
    duration_s: float = 0.0
    queue_bytes: int = 512 << 20


class Recording:
    """Owns the writer and its thread. ``stopped`` is set when recording ended on its own; ``reason`` says why."""

    def __init__(
        self,
        writer: BagWriter,
        *,
        limits: Limits = Limits(),
        images: str = "raw",
        images_paused: bool = False,
        codec: str = "rawvideo",
        monotonic_s: Callable[[], float],
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        flush_period_s: float = 0.1,
    ) -> None:
        self._writer, self._limits, self._images, self._codec = writer, limits, images, codec
        self._monotonic_s, self._free_bytes, self._flush_period_s = monotonic_s, free_bytes, flush_period_s
        self._flushed_s = 0.0
        self._queue: deque[Received | Callable[[], None]] = deque()
        self._queued_bytes = 0
        self._wake, self._finish = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._written_as: dict[str, str] = {}
        self._image_topics: set[str] = set()
        self._convert: dict[str, Callable[[bytes], bytes]] = {}
        self._videos: list[VideoFile] = []
        self._torn = False
        self.tallies: dict[str, Tally] = {}
        self.refused: dict[str, str] = {}
        self.stopped = threading.Event()
        self.on_stop: Callable[[], None] = lambda: None
        """Called in the thread in which recording ended on its own."""
        self.reason = ""
        self.failed = False
        self.paused = False
        self._pauses: list[str] = []
        self._paused_ns = 0
        self._clock_set: list[str] = []
        self.images_paused = images_paused
        self._closed = False
        self._check_free()
        if self.failed:
            writer.abandon()
            raise InputError(f"{writer.path}: {self.reason}")
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def add_topic(
        self,
        name: str,
        type_name: str,
        *,
        qos: tuple[Qos, ...] = (),
        definition: str | None = None,
        type_hash: str | None = None,
    ) -> None:
        """Queue the registration of a topic for the writer thread, ahead of its messages; no effect the second time."""
        self.tallies.setdefault(name, Tally())
        written = name
        if type_name == frames.RAW:
            self._image_topics.add(name)
        if type_name == frames.RAW and self._images != "raw":
            written, type_name = self._keep_frames(name)
            definition = type_hash = None
        self._written_as[name] = written
        self._queue.append(
            lambda: self._writer.add_topic(written, type_name, qos=qos, definition=definition, type_hash=type_hash)
        )
        self._wake.set()

    def attach(self, name: str, data: bytes) -> None:
        """Queue a YAML attachment for the writer thread, ahead of any later message."""
        self._queue.append(lambda: self._writer.attach(name, data, "application/yaml"))
        self._wake.set()

    def _keep_frames(self, name: str) -> tuple[str, str]:
        """Write a topic's images as JPEG or video; returns the topic and type that the bag then has."""
        if self._images == "jpeg":
            self._convert[name] = frames.to_jpeg
            return frames.compressed_name(name), frames.JPEG
        if name not in self._convert:
            file = VideoFile(self._writer.folder / video.file_name(name), self._codec)
            self._videos.append(file)
            self._convert[name] = file.add
        return video.index_name(name), video.INDEX

    def put(self, message: Received, *, sole_publisher: bool = True) -> None:
        """Take a message; never blocks on the disk."""
        tally = self.tallies[message.topic]
        tally.count(message.sequence if sole_publisher else 0)
        if self.paused or self.stopped.is_set() or (self.images_paused and message.topic in self._image_topics):
            return
        if self._queued_bytes + len(message.data) > self._limits.queue_bytes:
            tally.dropped += 1
            return
        with self._lock:
            self._queued_bytes += len(message.data)
        self._queue.append(message)
        self._wake.set()

    def lose(self, topic: str, count: int) -> None:
        """Count messages that the middleware reports as lost."""
        self.tallies[topic].reported += count

    def stop(self, reason: str) -> None:
        """End the recording as failed; the first reason is kept."""
        self.reason, self.failed = self.reason or reason, True
        self.stopped.set()

    def pause(self, paused: bool, now_ns: int) -> None:
        """Pause or resume recording; the pauses are noted in the bag, in log times."""
        if self.paused and not paused:
            self._pauses.append(f"{self._paused_ns} to {now_ns}")
        elif paused and not self.paused:
            self._paused_ns = now_ns
        self.paused = paused

    def clock_set(self, by_ns: int) -> None:
        """Note that the host's clock was set by so much: log times before and after don't fit together."""
        self._clock_set.append(f"{by_ns * 1e-9:+.6f}")

    def refuse(self, topic: str, why: str) -> None:
        """Note that a selected topic can't be recorded; the others are recorded all the same."""
        self.refused[topic] = why

    def close(self, metadata: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Write the queue, the counts and ``metadata`` records (with exit_status), and close the bag; idempotent."""
        if self._closed:
            return
        self._closed = True
        self._finish.set()
        self._wake.set()
        self._thread.join()
        for file in self._videos:
            file.close()
        if not self._torn:
            try:
                for name, values in self._records(metadata).items():
                    self._writer.metadata(name, values)
                self._writer.close()
                return
            except InputError as error:
                self.stop(str(error))
                self._writer.abandon()
                return
            except OSError as error:
                self.stop(f"{error.strerror}: {self._writer.path}")
        try:
            self._writer.close_short(lambda: self._records(metadata))
        except OSError:  # not even the summary fits; `recover` can bring back what was flushed
            self._writer.abandon()

    def _records(self, metadata: Mapping[str, Mapping[str, str]] | None) -> dict[str, Mapping[str, str]]:
        """The final metadata records; their exit_status is "ok" unless the recording failed or ``metadata`` has one."""
        counts = self._writer.counts
        for name, tally in self.tallies.items():
            kept = counts.get(self._written_as[name], 0)
            tally.dropped, tally.written = tally.dropped + tally.written - kept, kept
        records: dict[str, Mapping[str, str]] = {"recording": self.summary()}
        for name, values in (metadata or {}).items():
            records[name] = {"exit_status": self.reason or "ok", **values}
        return records

    def summary(self) -> dict[str, str]:
        """Counts and losses by topic, pauses, steps of the host's clock, and how the recording ended."""
        incomplete = f"incomplete, not recorded: {', '.join(self.refused)}" if self.refused else ""
        values = {"exit_status": self.reason or incomplete or "ok"}
        for name, tally in self.tallies.items():
            values[name] = f"written {tally.written}, lost {tally.lost}, dropped {tally.dropped}"
        if pauses := [*self._pauses, *([f"{self._paused_ns} to {PAUSED_TO_THE_END}"] if self.paused else [])]:
            values[PAUSED] = ", ".join(pauses)
        if self._clock_set:
            values[CLOCK_SET] = ", ".join(self._clock_set)
        return values | {name: f"not recorded: {why}" for name, why in self.refused.items()}

    @property
    def path(self) -> Path:
        """The bag."""
        return self._writer.path

    @property
    def lost(self) -> int:
        """Messages known to have been sent that are not in the bag."""
        return sum(tally.lost + tally.dropped for tally in self.tallies.values())

    @property
    def written(self) -> int:
        """Messages in the bag."""
        return sum(tally.written for tally in self.tallies.values())

    @property
    def size_bytes(self) -> float:
        """Current size of the bag on disk; NaN if that can't be read."""
        return _or_nan(lambda: sum(map(_size_bytes, self._writer.folder.glob("*"))))

    @property
    def free_bytes(self) -> float:
        """Free space on the bag's disk; NaN if that can't be read."""
        return _or_nan(lambda: self._free_bytes(self._writer.path.parent))

    def last_line(self) -> str:
        """The summary line printed at the end."""
        losses = [
            f"{name} {tally.lost + tally.dropped}" for name, tally in self.tallies.items() if tally.lost + tally.dropped
        ]
        what = f"{self.lost} lost ({', '.join(losses)})" if losses else "0 lost"
        heard = sum(tally.written > 0 for tally in self.tallies.values())
        refused = f", {counted(len(self.refused), 'topic')} not recorded ({', '.join(self.refused)})"
        what += refused if self.refused else ""
        ended = f"; stopped: {self.reason}" if self.reason else ""
        written = f"{counted(self.written, 'message')} of {counted(heard, 'topic')}"
        return f"recorded {written} to {self._writer.path}, {what}{ended}"

    def _run(self) -> None:
        start = self._flushed_s = self._monotonic_s()
        try:
            ended = False
            while not ended:
                self._wake.wait(0.1)
                self._finish.wait(_BATCH_S)
                self._wake.clear()
                ended = self._finish.is_set() or self.stopped.is_set()
                self._drain()
                now_s = self._flush_if_due()
                if self._limits.duration_s and now_s - start >= self._limits.duration_s:
                    self.stopped.set()
        except OSError as error:
            self._torn = True
            self.stop(f"{error.strerror}: {self._writer.path}")
        except InputError as error:
            self.stop(str(error))
        except Exception as error:
            # From a codec, for example. Whatever it is, a bag whose writer died must not be marked ok.
            self.stop(f"{type(error).__name__}: {' '.join(str(error).split())}")
        finally:
            self.stopped.set()
            if not self._finish.is_set():
                self.on_stop()

    def _drain(self) -> None:
        while self._queue:
            work = self._queue.popleft()
            if isinstance(work, Received):
                with self._lock:
                    self._queued_bytes -= len(work.data)
                self._write(work)
            else:
                work()
            # Also here: on a busy machine the queue may not empty for seconds, and a full disk shows only on writing.
            self._flush_if_due()

    def _flush_if_due(self) -> float:
        """Flush to disk if the period has elapsed; returns the current time [s]."""
        now_s = self._monotonic_s()
        if now_s - self._flushed_s >= self._flush_period_s:
            self._flushed_s = now_s
            self._writer.flush()
            self._check_free()
        return now_s

    def _write(self, message: Received) -> None:
        name, data = self._written_as[message.topic], message.data
        if (convert := self._convert.get(message.topic)) is not None:
            data = convert(data)
        self._writer.write(name, data, message.log_time_ns, message.publish_time_ns, message.sequence)
        self.tallies[message.topic].written += 1

    def _check_free(self) -> None:
        free = self._free_bytes(self._writer.path.parent)
        if free < self._limits.min_free:
            self.stop(f"only {free >> 20} MiB free, {self._limits.min_free >> 20} MiB are to stay free (--min-free)")


def _or_nan(figure: Callable[[], float]) -> float:
    """A figure of the disk; NaN if it is gone: the report that the recording failed must not fail for it."""
    try:
        return figure()
    except OSError:
        return math.nan


def _size_bytes(file: Path) -> int:
    """Size of a file; 0 if it is gone, as metadata.yaml is written to a temporary file that is then renamed."""
    try:
        return file.stat().st_size
    except FileNotFoundError:
        return 0
