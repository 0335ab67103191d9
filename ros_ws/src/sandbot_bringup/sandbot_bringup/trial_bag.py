"""The messages of one batch trial, collected in the trial's own time and written in order of time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_bed.protocol import Command, Stage
from sandbot_bed.status import status_message
from sandbot_common import messages, topics
from sandbot_common.arrays import Floats
from sandbot_common.serialization import to_cdr
from sandbot_common.topics import Topic
from sandbot_record.bags.frames import encode_jpeg
from sandbot_record.bags.video import INDEX, VideoFile, file_name, index_name
from sandbot_record.bags.writer import BagWriter
from sandbot_tracking.calibration import Camera
from sandbot_tracking.offline import Sample
from sandbot_tracking.period import PeriodMean

HEIGHT_PERIOD_S = 0.1
_INDEX = {name: Topic(index_name(view.image.name), INDEX) for name, view in topics.VIEWS.items()}
_LOSSLESS = "rawvideo"


class TrialBag:
    """Bed time runs from the wall-clock instant ``start_ns``, trial time from the start of the legs."""

    def __init__(self, start_ns: int, leg_order: Sequence[str] = topics.LEGS) -> None:
        self._start_ns, self._leg_order = start_ns, leg_order
        self._zero_ns = start_ns
        self._messages: list[tuple[int, Topic, bytes]] = []
        self._stage: tuple[Stage, int] | None = None
        self._blower = -1.0
        self._next_height_s = 0.0

    def add(self, topic: Topic, t_ns: int, message: Any) -> None:
        """Add a message, stamped and logged at the same instant."""
        self._messages.append((t_ns, topic, to_cdr(message)))

    def announce(self, trial: str) -> None:
        """Announce the trial, before anything happens."""
        self.add(topics.TRIAL, self._start_ns, messages.string(trial))

    def legs_start(self, lead_s: float) -> None:
        """Set time zero, ``lead_s`` after the start; the synchronisation LED goes on."""
        self._zero_ns = self._start_ns + round(lead_s * 1e9)
        self.add(topics.SYNC_LED, self._zero_ns, messages.header(self._zero_ns, "sync_led"))

    def legs(self, topic: Topic, t_s: Floats, angles: Floats, rates: Floats, efforts: Floats) -> None:
        """Joint states of shape (n, legs)."""
        for t, angle, rate, effort in zip(t_s, angles, rates, efforts, strict=True):
            stamp = self._at(t)
            self.add(topic, stamp, messages.joint_state(stamp, self._leg_order, angle, rate, effort))

    def frame(self, camera: str, t_s: float, pixels: NDArray[np.uint8], kept: str) -> None:
        """Add a frame: ``kept`` raw, as jpeg, in a video file next to the messages, or not at all."""
        stamp, frame = self._at(t_s), topics.optical_frame(camera)
        if kept == "raw":
            self.add(topics.VIEWS[camera].image, stamp, messages.image(stamp, frame, pixels))
        elif kept == "video":
            self.add(_INDEX[camera], stamp, messages.image(stamp, frame, pixels))
        elif kept == "jpeg":
            self.add(topics.VIEWS[camera].jpeg, stamp, messages.jpeg(stamp, frame, encode_jpeg(pixels)))

    def camera(self, name: str, t_s: float, camera: Camera) -> None:
        """Add a camera's intrinsics."""
        stamp, frame, size = self._at(t_s), topics.optical_frame(name), (camera.width, camera.height)
        self.add(
            topics.VIEWS[name].info, stamp, messages.camera_info(stamp, frame, size, camera.matrix, camera.distortion)
        )

    def bed(self, t_s: float, command: Command) -> None:
        """One step of the bed's preparation: status and blower where they change, the height ten times a second."""
        stamp = self._start_ns + round(t_s * 1e9)
        if command.blower != self._blower:
            self._blower = command.blower
            self.add(topics.BED_BLOWER, stamp, messages.float64(command.blower))
        if (command.stage, command.pulses) != self._stage:
            self._stage = (command.stage, command.pulses)
            self.add(topics.BED_STATUS, stamp, status_message(stamp, command))
        if t_s >= self._next_height_s:
            self._next_height_s += HEIGHT_PERIOD_S
            self.add(topics.BED_HEIGHT, stamp, messages.range_(stamp, command.height_m, 0.0, 1.0, "bed"))
        if command.stage is Stage.READY:
            self.add(topics.BED_PHI, stamp, messages.float64(command.phi))

    def sample(self, sample: Sample) -> None:
        """Landmarks and speed of one frame, as the tracker node publishes them."""
        stamp = self._at(sample.t_s)
        self.add(topics.COM, stamp, messages.point(stamp, sample.com))
        self.add(topics.FRONT_AXLE, stamp, messages.point(stamp, sample.front_axle))
        self.add(topics.REAR_AXLE, stamp, messages.point(stamp, sample.rear_axle))
        self.add(topics.SPEED, stamp, messages.twist(stamp, sample.v_x, sample.v_z, sample.var_x, sample.var_z))

    def period(self, t_s: float, mean: PeriodMean) -> None:
        """Mean speed and lift of the leg period that ended just now, as the tracker node publishes them."""
        self.add(topics.SPEED_MEAN, self._at(t_s), messages.float64(mean.speed_m_s))
        self.add(topics.LIFT, self._at(t_s), messages.float64(mean.lift_m))

    def write(self, path: Path, metadata: Mapping[str, str], attachments: Mapping[str, str]) -> None:
        """Write the bag under its name, whole or not at all.

        Its folder is made, but not the campaign's: renamed meanwhile, it would come back with part of the trials.
        """
        path.parent.mkdir(exist_ok=True)
        with BagWriter(path) as writer:
            # A video file is opened at its first frame; until then the frames themselves are stored under its index.
            videos = {
                index: VideoFile(writer.folder / file_name(topics.VIEWS[name].image.name), _LOSSLESS)
                for name, index in _INDEX.items()
            }
            for t_ns, topic, cdr in sorted(self._messages, key=lambda message: message[0]):
                writer.write(topic, videos[topic].add(cdr) if topic in videos else cdr, t_ns)
            for video in videos.values():
                video.close()
            writer.metadata("trial", metadata)
            for name, text in attachments.items():
                writer.attach(name, text.encode(), "application/yaml")

    def _at(self, t_s: float) -> int:
        return self._zero_ns + round(float(t_s) * 1e9)
