"""The tracker node: publishes /landmarks/*, /speed, /speed/mean and /lift from both cameras' frames."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription

from sandbot_common import health, messages, topics
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.robot import read_robot, robot_of_trial
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_common.ros.timer import Timer
from sandbot_common.topics import Topic
from sandbot_tracking.calibration import checksum, read_cameras
from sandbot_tracking.latency import Latency
from sandbot_tracking.live import LiveTracker, warm_up
from sandbot_tracking.offline import Sample
from sandbot_tracking.pixels import grey
from sandbot_tracking.tracker_parameters import TrackerParameters

_FOLLOW_S = 0.5
"""Period of checking the publishers of images."""
_FROZEN = 50
"""Identical frames in a row from which the image is reported as frozen."""
_BLIND_S = 0.5
"""A camera none of whose frames can be used for this long measures nothing; a few damaged ones are only left out."""


@dataclass
class Unusable:
    """Why frames can't be used, of cameras of whose frames none could be since. Times [s] of a monotonic clock."""

    _last: dict[str, tuple[float, float, str]] = field(default_factory=dict)

    def add(self, camera: str, why: str, now_s: float) -> None:
        """A frame could not be used."""
        since_s, _, _ = self._last.get(camera, (now_s, now_s, why))
        self._last[camera] = since_s, now_s, why

    def used(self, camera: str) -> None:
        """A frame was used."""
        self._last.pop(camera, None)

    @property
    def blind(self) -> str:
        """Why a camera measures nothing; empty if all do, or may."""
        return "; ".join(why for since_s, until_s, why in self._last.values() if until_s - since_s >= _BLIND_S)


class Input:
    """Subscription to what a driver offers: the first of ``offers`` that is published.

    Reliable if every publisher is, as a stall then loses nothing; best effort otherwise, as a reliable subscription
    would receive nothing.
    """

    def __init__(self, owner: Node, callback: Callable[[Any], None], *offers: Topic) -> None:
        self._owner, self._callback = owner, callback
        self._offers = offers
        self._now: tuple[Topic, bool] | None = None
        self._subscription: Subscription | None = None
        self.follow()

    def follow(self) -> None:
        """Subscribe again if the publishers have changed."""
        found = {topic: endpoints.reliabilities(self._owner, topic) for topic in self._offers}
        topic = next((topic for topic in self._offers if found[topic]), self._offers[0])
        wanted = topic, not all(found[topic])
        if wanted == self._now or (self._now is not None and not found[topic]):
            return
        if self._subscription is not None:
            self._owner.destroy_subscription(self._subscription)
        self._subscription = endpoints.subscription(self._owner, topic, self._callback, best_effort=wanted[1])
        self._now = wanted


_FIXED = ros_parameters.fixed("what the tracker knows is read at the start: restart the tracker to change it")


class TrackerNode(Node):
    """Wires a LiveTracker to the topics."""

    def __init__(self) -> None:
        super().__init__("tracker")
        self._settings = ros_parameters.Parameters(self, TrackerParameters, _FIXED)
        given = self._settings.current
        self._health = ros_health.Health(self, self._values, sole=True)
        named = {**topics.LANDMARKS, "speed": topics.SPEED, "mean": topics.SPEED_MEAN, "lift": topics.LIFT}
        self._publish = {name: endpoints.publisher(self, topic) for name, topic in named.items()}
        self._latency = Latency(given.latency_budget_s)
        self._unreadable, self._unusable = "", Unusable()
        path = given.cameras or config_file("cameras.yaml")
        cameras = read_cameras(path)
        if "dorsal" not in cameras:
            raise InputError(f"{path}: no 'dorsal' camera in it")
        self._calibration = checksum(cameras)
        robot = read_robot(given.robot or config_file("robot.yaml"))
        # Before subscribing: frames that came meanwhile would be lost once the queue is full.
        warm_up(cameras)
        self._live = LiveTracker(cameras, robot, given.pair_tolerance_s)
        self._inputs = [self._input(camera) for camera in self._live.views]
        self._inputs += [Input(self, self._legs, topics.LEG_STATES), Input(self, self._led, topics.SYNC_LED)]
        endpoints.subscription(self, topics.TRIAL, lambda trial: self._of_trial(trial.data))
        Timer(self, _FOLLOW_S, self._follow)

    def _input(self, camera: str) -> Input:
        view = topics.VIEWS[camera]
        return Input(self, lambda image: self._image(camera, image), view.image, view.jpeg)

    def _follow(self) -> None:
        for source in self._inputs:
            source.follow()
        self._publish_samples([])

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _of_trial(self, text: str) -> None:
        try:
            robot = robot_of_trial(text)
        except InputError as error:
            self.get_logger().error(str(error))
            return
        if robot is not None:
            self._live.track(robot)

    def _image(self, camera: str, image: Any) -> None:
        stamp = messages.nanoseconds(image.header.stamp)
        try:
            pixels = grey(image, self._settings.current.sensor_bits)
            self._publish_samples(self._live.frame(camera, stamp, pixels, self._now_ns()))
            self._unusable.used(camera)
        except InputError as error:
            self._unreadable = f"{camera}: {str(error).removeprefix(f'{camera} camera: ')}"
            self._unusable.add(camera, self._unreadable, time.monotonic())
            self.get_logger().error(self._unreadable, throttle_duration_sec=5.0)

    def _led(self, header: Any) -> None:
        self._unreadable = ""
        self._latency.restart()
        self._publish_samples(self._live.led(messages.nanoseconds(header.stamp)))

    def _legs(self, state: Any) -> None:
        given = dict(zip(state.name, state.position, strict=False))
        order = self._live.dimensions.leg_order
        if all(leg in given for leg in order):
            angles = np.array([given[leg] for leg in order])
            self._live.legs(messages.nanoseconds(state.header.stamp), angles, self._now_ns())
            self._publish_samples([])

    def _publish_samples(self, samples: Sequence[tuple[int, Sample]]) -> None:
        for t_ns, sample in samples:
            for name in ("com", "front_axle", "rear_axle"):
                self._publish[name].publish(messages.point(t_ns, getattr(sample, name)))
            self._publish["speed"].publish(messages.twist(t_ns, sample.v_x, sample.v_z, sample.var_x, sample.var_z))
            self._latency.add((self._now_ns() - t_ns) * 1e-9)
        for done in self._live.periods(self._now_ns()):
            self._publish["mean"].publish(messages.float64(done.speed_m_s))
            self._publish["lift"].publish(messages.float64(done.lift_m))

    def _values(self) -> dict[str, object]:
        warnings = [self._unreadable, self._latency.warning]
        for camera, view in self._live.views.items():
            warnings += [f"{camera}: {view.clock.warning}" if view.clock.warning else ""]
            warnings += [f"{camera}: the image is frozen" if view.frozen >= _FROZEN else ""]
        text = "; ".join(warning for warning in warnings if warning)
        self._health.level, self._health.text = (1, text) if text else (0, "ok")
        if blind := "; ".join(why for why in (self._unusable.blind, self._live.moved) if why):
            self._health.level, self._health.text = 2, blind  # a trial ends, as by a camera without frames
        return {health.CALIBRATION: self._calibration, **self._latency.values(), **self._live.figures}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the tracker node."""
    return node.run(TrackerNode, argv)
