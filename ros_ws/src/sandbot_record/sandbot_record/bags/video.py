"""Frames of one camera in a video file next to the .mcap, and a frame index topic with the time of each frame.

``<topic>/video`` carries one sensor_msgs/TimeReference a frame: header = the image's own (stamp, frame_id), time_ref =
the frame's place in the video, source = file name and the CRC-32 of the frame's pixels. The CRC links the two reliably:
a frame that was damaged, lost or shifted can't be mistaken for another.

Both codecs are lossless for mono8 pixels (HFYU and MJPG of these wheels are not). The container is AVI because it is
readable without the end that a killed writer never wrote; each frame is in the file before its index message is.
PyAV writes it, as OpenCV's writer does not tell that the disk is full.
"""

import contextlib
import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from sandbot_common.errors import InputError
from sandbot_record.bags import frames, interfaces
from sandbot_record.bags.frames import Pixels
from sandbot_record.bags.metadata import TopicInfo

# PyAV and OpenCV are imported with the first frame: most bags have no video.
if TYPE_CHECKING:
    import cv2
    from av.container import OutputContainer
    from av.video.stream import VideoStream

INDEX = "sensor_msgs/msg/TimeReference"
_SUFFIX = "/video"
RATE_HZ = 100
"""Nominal rate of the file, for video players; the actual time of each frame is in the topic."""
CODECS = MappingProxyType({"rawvideo": "GREY", "ffv1": "FFV1"})
"""rawvideo: as large as the pixels, 0.1 ms per 640×480 frame, and a flipped byte damages one frame; ffv1: about two
thirds of the size, 5 ms, and up to a dozen frames."""
_PASSED = 32
"""Frames kept in memory while resynchronising after damage."""


def index_name(topic: str) -> str:
    """The topic of the frame index of an image topic."""
    return f"{topic}{_SUFFIX}"


def file_name(topic: str) -> str:
    """The video file of an image topic."""
    return f"{topic.strip('/').replace('/', '-')}.avi"


def image_topic(topic: TopicInfo) -> str | None:
    """The image topic a frame index stands for; None if the topic is not a frame index."""
    return topic.name.removesuffix(_SUFFIX) if topic.type == INDEX and topic.name.endswith(_SUFFIX) else None


# Silences FFmpeg's messages about truncated files, whose frames are checked here; read when OpenCV first opens a video.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


@dataclass(frozen=True)
class Place:
    """Where a frame is: ``index`` in the video, and the CRC-32 of its pixels; ``header`` is the image's."""

    header: Any
    index: int
    crc: int


def place(cdr: bytes | memoryview) -> Place:
    """Parse a frame index message. Raises InputError if it is not one."""
    message = interfaces.decode(bytes(cdr), INDEX)
    try:
        crc = int(message.source.rpartition("crc32:")[2], 16)
    except ValueError:
        raise InputError(f"source {message.source!r} of a frame index does not end in crc32:...") from None
    t_ns = message.time_ref.sec * 1_000_000_000 + message.time_ref.nanosec
    return Place(message.header, round(t_ns * RATE_HZ / 1_000_000_000), crc)


class VideoFile:
    """Writes the frames of one image topic; not thread-safe."""

    def __init__(self, path: Path, codec: str) -> None:
        if codec not in CODECS:
            raise InputError(f"{path}: video codec {codec!r} is not one of {', '.join(CODECS)}")
        self._path, self._codec = path, codec
        self._film: tuple[OutputContainer, VideoStream] | None = None
        self._shape: tuple[int, ...] = ()
        self._count = 0

    def add(self, cdr: bytes | memoryview) -> bytes:
        """Append a CDR sensor_msgs/Image; returns its CDR frame index.

        Raises InputError if the frame does not fit those before it, or no longer fits on the disk.
        """
        image, pixels = frames.pixels_of(cdr, "video")
        return self.add_pixels(image.header, pixels)

    def add_pixels(self, header: Any, pixels: Pixels) -> bytes:
        """The same with the image's header and pixels (height, width)."""
        if pixels.ndim != 2:
            raise InputError(f"{self._path.name}: frames of shape {pixels.shape} can't become video: mono8 is needed")
        if self._count and pixels.shape != self._shape:
            raise InputError(f"{self._path.name}: a frame of shape {pixels.shape} does not fit those of {self._shape}")
        pixels = np.ascontiguousarray(pixels)
        self._write(pixels)
        store = interfaces.store()
        t_ns = self._count * 1_000_000_000 // RATE_HZ
        message = store.types[INDEX](
            header=header,
            time_ref=store.types["builtin_interfaces/msg/Time"](t_ns // 1_000_000_000, t_ns % 1_000_000_000),
            source=f"{self._path.name} crc32:{zlib.crc32(pixels.data):08x}",
        )
        self._count += 1
        return bytes(store.serialize_cdr(message, INDEX))

    def close(self) -> None:
        """Complete the file."""
        if self._film is not None:
            with contextlib.suppress(OSError):  # only the end is missing, and all frames can be read without it
                self._film[0].close()

    def _write(self, pixels: Pixels) -> None:
        import av

        try:
            file, stream = self._film = self._film or self._open(pixels.shape)
            frame = av.VideoFrame.from_numpy_buffer(pixels, format="gray")
            frame.pts = self._count
            file.mux(stream.encode(frame))
        except av.FFmpegError as error:
            raise InputError(f"{self._path}: {error.strerror}") from None

    def _open(self, shape: tuple[int, ...]) -> "tuple[OutputContainer, VideoStream]":
        import av

        height, width = self._shape = shape
        file = av.open(str(self._path), "w", format="avi", options={"flush_packets": "1"})
        stream = file.add_stream(self._codec, rate=RATE_HZ, width=width, height=height, pix_fmt="gray")
        stream.codec_context.codec_tag = CODECS[self._codec]
        return file, cast("VideoStream", stream)


class VideoFrames:
    """Reads frames by their place; fastest in increasing order. Not thread-safe.

    Frames missing from a damaged file shift all later ones, so a frame that is not the expected one is kept: it may be
    the one of a later place.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reader: cv2.VideoCapture | None = None
        self._next = 0
        self._gone = 0
        """Frames known to be missing before the next one."""
        self._passed: dict[int, tuple[int, Pixels]] = {}
        """Frames read but not yet requested, by CRC: place in the file, pixels."""

    def frame(self, place: Place) -> Pixels:
        """The pixels (height, width). Raises InputError if the frame is not there or not what was written."""
        # Sequentially, not by seeking: a truncated file has no index.
        if self._reader is None or place.index - self._gone < self._next - len(self._passed):
            self._open()
        if place.crc in self._passed:
            at, pixels = self._passed.pop(place.crc)
            self._gone = place.index - at
            return pixels
        pixels = self._read(place.index - self._gone)
        if (crc := zlib.crc32(pixels.data)) != place.crc:
            self._passed[crc] = (self._next - 1, pixels)
            if len(self._passed) > _PASSED:
                del self._passed[next(iter(self._passed))]
            raise InputError(f"{self.path}: frame {place.index} is damaged or missing")
        return pixels

    @property
    def codec(self) -> str:
        """The codec of the file; rawvideo if it is none of ours."""
        import cv2

        # A reader that leaves grey frames grey tells the pixels' format in place of the codec.
        four = int(cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG).get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little")
        return next((name for name, code in CODECS.items() if four.upper() == code.encode()), "rawvideo")

    def _read(self, at: int) -> Pixels:
        """The frame at this place of the file."""
        assert self._reader is not None
        while self._next < at and self._reader.grab():
            self._next += 1
        good, pixels = self._reader.read() if self._next == at else (False, None)
        if not good:
            raise InputError(f"{self.path}: frame {at} is not there, the video ends after {self._next}")
        self._next += 1
        return np.ascontiguousarray(pixels, dtype=np.uint8)

    def _open(self) -> None:
        import cv2

        if not self.path.is_file():
            raise InputError(f"{self.path}: no such video")
        self._next = self._gone = 0
        self._passed.clear()
        with _quiet():
            self._reader = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_CONVERT_RGB, 0])
        if not self._reader.isOpened():
            self._reader = None
            raise InputError(f"{self.path}: not a video OpenCV can read")


class Transfer:
    """Copies the intact frames of a video to a new one."""

    def __init__(self, source: Path, folder: Path) -> None:
        self._frames, self._folder = VideoFrames(source), folder
        self._file: VideoFile | None = None

    def __call__(self, cdr: bytes | memoryview) -> bytes:
        """Copy the frame of an index message; returns its new index. Raises InputError if it is missing or damaged."""
        at = place(cdr)
        pixels = self._frames.frame(at)
        if self._file is None:
            self._file = VideoFile(self._folder / self._frames.path.name, self._frames.codec)
        return self._file.add_pixels(at.header, pixels)

    def close(self) -> None:
        """Complete the new file."""
        if self._file is not None:
            self._file.close()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress OpenCV's warning that grey frames are not converted to colour, which is intended."""
    import cv2

    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
