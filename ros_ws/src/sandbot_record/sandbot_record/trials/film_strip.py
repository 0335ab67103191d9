"""A strip of tracked video out of a bag: the kept lateral frames with the tracked marks drawn on them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.files import load_yaml
from sandbot_record.bags import frames, metadata, video
from sandbot_record.bags.frames import Pixels
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.trials.from_bags import bags_in, start_ns
from sandbot_tracking.calibration import Camera, cameras_from_mapping

Strip = list[tuple[bytes, str]]
"""(JPEG bytes, caption) of each frame."""

SCALE = 1.5
"""Frames are enlarged before the marks are drawn, so that a mark is thinner than the disc it marks."""
ROWS_KEPT = (0.45, 0.75)
"""The part of the frame's height in which the robot walks."""
_MARKS = {topics.FRONT_AXLE: (0, 165, 255), topics.REAR_AXLE: (255, 170, 0)}
_RAW = topics.LATERAL_IMAGE.name
_FRAMES = (topics.LATERAL_JPEG.name, _RAW, video.index_name(_RAW))
_POINT = ("point.x", "point.y", "point.z")


def film_strip(data: Path, count: int = 4) -> Strip:
    """``count`` frames over one steady step of the first bag in ``data`` that kept its lateral frames; else none."""
    bags = bags_in(data) if data.is_dir() else []
    for path in bags:
        # metadata.yaml tells without reading the bag whether frames were kept.
        info = metadata.read(path) if path.is_dir() else None
        if info is not None and any(topic.name in _FRAMES and topic.count for topic in info.topics):
            bag = Bag.open(path)
            if "cameras.yaml" in bag.attachments:
                return _strip(bag, count)
    return []


def _strip(bag: Bag, count: int) -> Strip:
    try:
        content = load_yaml(bag.attachments["cameras.yaml"].decode())
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{bag.path}: attachment cameras.yaml: {error}") from None
    camera = cameras_from_mapping(content, f"{bag.path}: cameras.yaml")["lateral"]
    zero_ns = start_ns(bag)
    marks = {topic: bag.columns(topic.name, *_POINT, *FIELD_STAMP) for topic in _MARKS}
    stamps, picture = _frames(bag)
    wanted = [int(np.argmin(np.abs(stamps - t))) for t in _moments(marks[topics.FRONT_AXLE], zero_ns, count)]
    return [
        (
            _drawn(picture(i), camera, marks, int(stamps[i])),
            f"t = {(stamps[i] - zero_ns) * 1e-9:.2f} s ({bag.path.name}, lateral camera)",
        )
        for i in wanted
    ]


def _frames(bag: Bag) -> tuple[NDArray[np.int64], Callable[[int], Pixels]]:
    """Stamps (n,) [ns] of the lateral frames, and how to get frame i in grey."""
    if topics.LATERAL_JPEG.name in bag.topics:
        name = topics.LATERAL_JPEG.name
        kept = sorted(bag.messages([name]), key=lambda message: message.log_time_ns)
        return bag.columns(name, *FIELD_STAMP).stamp_ns, lambda i: frames.grey_of_jpeg(kept[i].decode().data)
    timeline = Timeline(bag, [_RAW])
    named = next(name for name in (_RAW, video.index_name(_RAW)) if name in bag.topics)
    stamps = bag.columns(named, *FIELD_STAMP).stamp_ns
    return stamps, lambda i: frames.pixels_of(timeline[i].data, "grey")[1]


def _moments(axle: Any, zero_ns: int, count: int) -> NDArray[np.float64]:
    """Instants through one rise and fall of the axle, about the highest one after the first second."""
    stamps, height = axle.stamp_ns, np.nan_to_num(axle["point.z"])
    steady = stamps > zero_ns + 400_000_000
    if not steady.any():
        steady = stamps > zero_ns
    top = int(stamps[steady][np.argmax(height[steady])])
    return np.asarray(top + 1e9 * np.linspace(-0.06, 0.06, count))


def _drawn(grey: Pixels, camera: Camera, marks: dict[topics.Topic, Any], stamp_ns: int) -> bytes:
    picture = cv2.cvtColor(
        cv2.resize(grey, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_CUBIC), cv2.COLOR_GRAY2BGR
    )
    for topic, colour in _MARKS.items():
        columns = marks[topic]
        nearest = int(np.argmin(np.abs(columns.stamp_ns - stamp_ns)))
        xyz = np.array([[columns[name][nearest] for name in _POINT]])
        if np.isfinite(xyz).all():
            u, v = (SCALE * (camera.to_pixels(xyz)[0] + 0.5) - 0.5).round().astype(int).tolist()
            cv2.drawMarker(picture, (u, v), colour, cv2.MARKER_CROSS, 22, 1, cv2.LINE_AA)
            cv2.circle(picture, (u, v), 13, colour, 1, cv2.LINE_AA)
    top, bottom = (int(share * len(picture)) for share in ROWS_KEPT)
    encoded = cv2.imencode(".jpg", picture[top:bottom], [cv2.IMWRITE_JPEG_QUALITY, 85])[1]
    return bytes(encoded.tobytes())
