"""The lateral film of a trial: its frames with the tracked markers drawn on them, and the time of each."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_common import topics
from sandbot_record.bags import frames, video
from sandbot_record.bags.frames import Pixels
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.trials.from_bags import start_ns
from sandbot_record.trials.setting import attached_cameras
from sandbot_tracking.calibration import Camera, cameras_from_mapping

SCALE = 1.5
"""Frames are enlarged before the marks are drawn, so that a mark is thinner than the marker disc."""
ROWS_KEPT = (0.45, 0.75)
"""The part of the frame's height in which the robot walks, from the top."""
MARKS = {topics.FRONT_AXLE: (0, 165, 255), topics.REAR_AXLE: (255, 170, 0)}
_RAW = topics.LATERAL_IMAGE.name
KEPT = (topics.LATERAL_JPEG.name, _RAW, video.index_name(_RAW))
"""Topics that may hold the lateral frames; a bag with frames has one of them."""
_POINT = ("point.x", "point.y", "point.z")


@dataclass(frozen=True)
class Film:
    """Frame ``i`` was taken at ``stamp_ns[i]``; ``zero_ns`` is when the legs started. Thread-safe."""

    stamp_ns: NDArray[np.int64]  # (n,)
    zero_ns: int
    marks: dict[topics.Topic, Any]
    """Columns of the tracked axles."""
    camera: Camera
    grey: Callable[[int], Pixels]

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Time of each frame since the start of the legs [s], (n,)."""
        return np.asarray((self.stamp_ns - self.zero_ns) * 1e-9)

    def picture(self, i: int) -> Pixels:
        """Frame ``i`` in colour (BGR) with the axles marked, cropped to the part in which the robot walks."""
        picture = cv2.cvtColor(
            cv2.resize(self.grey(i), None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_CUBIC), cv2.COLOR_GRAY2BGR
        )
        for topic, colour in MARKS.items():
            columns = self.marks[topic]
            nearest = int(np.argmin(np.abs(columns.stamp_ns - self.stamp_ns[i])))
            xyz = np.array([[columns[name][nearest] for name in _POINT]])
            if np.isfinite(xyz).all():
                u, v = (SCALE * (self.camera.to_pixels(xyz)[0] + 0.5) - 0.5).round().astype(int).tolist()
                cv2.drawMarker(picture, (u, v), colour, cv2.MARKER_CROSS, 22, 1, cv2.LINE_AA)
                cv2.circle(picture, (u, v), 13, colour, 1, cv2.LINE_AA)
        top, bottom = (int(share * len(picture)) for share in ROWS_KEPT)
        return np.asarray(picture[top:bottom])

    def jpeg(self, i: int) -> bytes:
        """The same as a JPEG."""
        return bytes(cv2.imencode(".jpg", self.picture(i), [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes())


def film_of(bag: Bag) -> Film | None:
    """The film of a bag with frames of a calibrated lateral camera, else None.

    Raises InputError if the attached calibration is invalid.
    """
    if not any(name in bag.topics for name in KEPT) or (content := attached_cameras(bag)) is None:
        return None
    camera = cameras_from_mapping(content, f"{bag.path}: cameras.yaml").get("lateral")
    if camera is None:
        return None
    marks = {topic: bag.columns(topic.name, *_POINT, *FIELD_STAMP) for topic in MARKS}
    named = next(name for name in KEPT if name in bag.topics)
    stamps = bag.columns(named, *FIELD_STAMP).stamp_ns
    return Film(stamps, start_ns(bag), marks, camera, _reader(bag)) if len(stamps) else None


def _reader(bag: Bag) -> Callable[[int], Pixels]:
    """A function that returns frame i in grey."""
    if topics.LATERAL_JPEG.name in bag.topics:
        kept = sorted(bag.messages([topics.LATERAL_JPEG.name]), key=lambda message: message.log_time_ns)
        return lambda i: frames.grey_of_jpeg(kept[i].decode().data)
    timeline, lock = Timeline(bag, [_RAW]), threading.Lock()

    def grey(i: int) -> Pixels:
        with lock:  # a video is read by one decoder, which keeps its place
            return frames.pixels_of(timeline[i].data, "grey")[1]

    return grey
