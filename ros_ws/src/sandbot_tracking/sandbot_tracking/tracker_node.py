"""The tracker node: both cameras' frames to /landmarks/*, /speed, /speed/mean and /lift."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ament_index_python.packages import get_package_share_directory
from rclpy.node import Node

from sandbot_common import messages, node, topics
from sandbot_common.errors import InputError
from sandbot_common.parameters import parameter
from sandbot_common.robot import read_robot, robot_of_trial
from sandbot_tracking.calibration import read_cameras
from sandbot_tracking.markers import Frame
from sandbot_tracking.offline import OfflineTracker, Sample
from sandbot_tracking.pairing import Pairing
from sandbot_tracking.period import PeriodMeans


@dataclass(frozen=True)
class TrackerParameters:
    """What the tracker needs to know."""

    cameras: str = parameter("", doc="YAML file of the calibrated cameras (dorsal, lateral); empty: the project's own")
    robot: str = parameter("", doc="YAML file of the robot; empty: SandBot. One that /trial tells goes before it")


class TrackerNode(Node):
    """Wires an OfflineTracker to the topics."""

    def __init__(self) -> None:
        super().__init__("tracker")
        self._settings = node.Parameters(self, TrackerParameters, _fixed)
        current = self._settings.current
        self._cameras = read_cameras(current.cameras or _own("cameras.yaml"))
        self._robot = read_robot(current.robot or _own("robot.yaml"))
        self._publish = {
            name: node.publisher(self, topic)
            for name, topic in (
                ("com", topics.COM), ("front_axle", topics.FRONT_AXLE), ("rear_axle", topics.REAR_AXLE),
                ("speed", topics.SPEED), ("mean", topics.SPEED_MEAN), ("lift", topics.LIFT),
            )
        }  # fmt: skip
        self._latency_ms: list[float] = []
        self._lost_frames = 0
        self._pairing: Pairing[Frame] = Pairing(("dorsal", "lateral") if "lateral" in self._cameras else ("dorsal",))
        self._begin()
        node.subscription(self, topics.DORSAL_IMAGE, lambda image: self._image("dorsal", image))
        node.subscription(self, topics.LATERAL_IMAGE, lambda image: self._image("lateral", image))
        node.subscription(self, topics.LEG_STATES, self._legs)
        node.subscription(self, topics.SYNC_LED, lambda _: self._begin())
        node.subscription(self, topics.TRIAL, lambda trial: self._of_trial(trial.data))
        self._health = node.Health(self, self._values)

    def _begin(self) -> None:
        # Each trial's LED edge: the robot has been carried back to the start, so its marks are looked for anew.
        self._tracker = OfflineTracker(self._cameras, self._robot, keep=False)
        self._means = PeriodMeans()

    def _of_trial(self, text: str) -> None:
        try:
            robot = robot_of_trial(text)
        except InputError as error:
            self.get_logger().error(str(error))
            return
        if robot is not None and robot != self._robot:
            self._robot = robot
            self._begin()

    def _image(self, camera: str, image: Any) -> None:
        stamp = messages.nanoseconds(image.header.stamp)
        try:
            pixels = messages.pixels(image)
        except InputError as error:
            self.get_logger().error(f"{camera}: {error}", throttle_duration_sec=5.0)
            return
        if camera in self._cameras:
            for t_ns, frames in self._pairing.add(stamp, camera, pixels):
                self._sample(t_ns, frames)

    def _sample(self, t_ns: int, frames: dict[str, Frame]) -> None:
        dorsal, lateral = frames.get("dorsal"), frames.get("lateral")
        self._lost_frames += len(self._cameras) - len(frames)
        sample = self._tracker.update(t_ns * 1e-9, dorsal, lateral)
        for name in ("com", "front_axle", "rear_axle"):
            self._publish[name].publish(messages.point(t_ns, getattr(sample, name)))
        if dorsal is not None:
            twist = messages.twist(t_ns, sample.v_x, sample.v_z, sample.var_x, sample.var_z)
            self._publish["speed"].publish(twist)
            self._latency_ms = [*self._latency_ms[-999:], (self.get_clock().now().nanoseconds - t_ns) * 1e-6]
        self._means_of(sample)

    def _means_of(self, sample: Sample) -> None:
        z = (sample.front_axle[2] + sample.rear_axle[2]) / 2
        done = self._means.update(sample.t_s, sample.com[0], z, self._tracker.clock.advance_rad())
        if done is not None:
            self._publish["mean"].publish(messages.float64(done.speed_m_s))
            self._publish["lift"].publish(messages.float64(done.lift_m))

    def _legs(self, state: Any) -> None:
        given = dict(zip(state.name, state.position, strict=False))
        if all(leg in given for leg in topics.LEGS):
            angles = np.array([given[leg] for leg in topics.LEGS])
            self._tracker.legs(messages.nanoseconds(state.header.stamp) * 1e-9, angles)

    def _values(self) -> dict[str, object]:
        latency = f"{np.median(self._latency_ms):.2f}" if self._latency_ms else "none yet"
        values: dict[str, object] = {"latency_ms_median": latency, "lost_frames": self._lost_frames}
        for camera, counts in self._tracker.counts.items():
            for what in ("frames", "missing", "lost", "reacquired", "ambiguous"):
                values[f"{camera}_{what}"] = getattr(counts, what)
        return values


def _own(name: str) -> Path:
    # Found by name in the overlay, as any ROS package's share: this room does not import bringup.
    return Path(get_package_share_directory("sandbot_bringup")) / "config" / name


def _fixed(_: TrackerParameters) -> None:
    raise InputError("cameras and robot are read at the start: restart the tracker to change them")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the tracker node."""
    return node.run(TrackerNode, argv)
