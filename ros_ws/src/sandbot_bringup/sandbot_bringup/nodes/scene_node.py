"""The scene node: bed, robot and marks as /scene, and the poses of body and cameras as /frames, for RViz and Foxglove.

/frames replaces /tf, whose message package (tf2_msgs) has no wheel. Foxglove accepts it directly.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node

from sandbot_bringup.scene import Pose, body_pose, camera_pose, scene
from sandbot_bringup.scene_messages import marker_array, transform
from sandbot_bringup.scene_parameters import SceneParameters
from sandbot_common import topics
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, read_robot, robot_of_trial
from sandbot_common.ros import endpoints, node, ros_parameters
from sandbot_common.ros.timer import Timer
from sandbot_tracking.calibration import read_cameras

BODY_FRAME = "base_link"


_FIXED = ros_parameters.fixed("the scene's parameters are read at the start: restart it to change them")


class SceneNode(Node):
    """Keeps the latest state, and draws it if there are subscribers."""

    def __init__(self) -> None:
        super().__init__("scene")
        given = ros_parameters.Parameters(self, SceneParameters, _FIXED).current
        cameras = read_cameras(given.cameras or config_file("cameras.yaml"))
        self._cameras = {topics.optical_frame(name): camera_pose(camera) for name, camera in cameras.items()}
        self._robot = read_robot(given.robot) if given.robot else SANDBOT
        self._marks = {name: np.full(3, np.nan) for name in topics.LANDMARKS}
        self._angles: dict[str, float] = {}
        self._phi, self._blows = np.nan, False
        self._shapes, self._frames = endpoints.publisher(self, topics.SCENE), endpoints.publisher(self, topics.FRAMES)
        for name, topic in topics.LANDMARKS.items():
            endpoints.subscription(self, topic, partial(self._on_mark, name), best_effort=True)
        endpoints.subscription(self, topics.LEG_STATES, self._on_legs, best_effort=True)
        endpoints.subscription(self, topics.BED_BLOWER, self._on_blower, best_effort=True)
        endpoints.subscription(self, topics.BED_PHI, self._on_phi)
        endpoints.subscription(self, topics.TRIAL, self._on_trial)
        Timer(self, 1.0 / given.rate_hz, self._draw)

    def _draw(self) -> None:
        now_ns = int(self.get_clock().now().nanoseconds)
        if self._shapes.get_subscription_count():
            shapes = scene(self._robot, self._marks, self._angles, self._phi, blows=self._blows)
            self._shapes.publish(marker_array(now_ns, shapes))
        if self._frames.get_subscription_count():
            frames: dict[str, Pose | None] = {**self._cameras, BODY_FRAME: body_pose(self._marks)}
            for name, pose in frames.items():
                if pose is not None:
                    self._frames.publish(transform(now_ns, name, pose))

    def _on_mark(self, name: str, message: Any) -> None:
        point = message.point
        self._marks[name] = np.array([point.x, point.y, point.z])

    def _on_legs(self, message: Any) -> None:
        self._angles = dict(zip(message.name, message.position, strict=False))

    def _on_blower(self, message: Any) -> None:
        # "not <=" so that NaN counts as on.
        self._blows = not message.data <= 0

    def _on_phi(self, message: Any) -> None:
        self._phi = message.data

    def _on_trial(self, message: Any) -> None:
        try:
            self._robot = robot_of_trial(message.data) or self._robot
        except InputError as error:
            self.get_logger().error(str(error))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return node.run(SceneNode, argv)


if __name__ == "__main__":
    raise SystemExit(main())
