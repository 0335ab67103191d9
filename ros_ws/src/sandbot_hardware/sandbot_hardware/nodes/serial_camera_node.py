"""A camera that sends JPEG frames over a serial line: image_raw and camera_info of one view.

A frame's stamp is the middle of its exposure by the camera's clock, converted to the host's as well as the line allows;
the tracker finds the remaining offset from the sync LED.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from rclpy.node import Node

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.host_clock import HostClock
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_hardware.device_clock import DeviceClock
from sandbot_hardware.lines import Line
from sandbot_hardware.port import Port, fixed
from sandbot_hardware.serial_camera_parameters import SerialCameraParameters
from sandbot_tracking.calibration import read_cameras

NAME = "serial_camera"


class SerialCamera(Node):
    """Publishes each frame as it arrives."""

    def __init__(self) -> None:
        super().__init__(NAME)
        given = ros_parameters.Parameters(self, SerialCameraParameters, fixed).current
        self._frame = topics.optical_frame(given.camera)
        self._device_clock, self._host_clock = DeviceClock(), HostClock()
        self._info = None
        if given.cameras:
            cameras = read_cameras(given.cameras)
            if given.camera not in cameras:
                raise InputError(f"{given.cameras}: no camera {given.camera!r}; known: {', '.join(cameras)}")
            used = cameras[given.camera]
            self._info = messages.camera_info(0, self._frame, (used.width, used.height), used.matrix, used.distortion)
        # Told apart by their names: nodes of the usual one may be those of both views.
        self._health = ros_health.Health(self, self._figures, sole=self.get_name() != NAME)
        view = topics.VIEWS[given.camera]
        self._image, self._camera_info = endpoints.publisher(self, view.image), endpoints.publisher(self, view.info)
        self._frames = self._unreadable = 0
        self._port = Port(given.device, given.baud, self._heard, self.get_logger().warning)

    def close(self) -> None:
        """Release the line."""
        self._port.close()

    def _heard(self, line: Line, received_ns: int) -> None:
        if line.kind != "C" or not line.block or not self._health.settled:
            return  # before it is settled, another node may be publishing this view
        pixels = cv2.imdecode(np.frombuffer(line.block, np.uint8), cv2.IMREAD_GRAYSCALE)
        if pixels is None:
            self._unreadable += 1
            return
        sent_ns = self._device_clock.host_ns(int(line.values[0]) * 1000, received_ns)
        t_ns = sent_ns + self._host_clock.ahead_ns()
        self._frames += 1
        self._image.publish(messages.image(t_ns, self._frame, pixels.astype(np.uint8, copy=False)))
        if self._info is not None:
            self._info.header = messages.header(t_ns, self._frame)
            self._camera_info.publish(self._info)

    def _figures(self) -> dict[str, Any]:
        self._health.level, self._health.text = self._port.health
        return {
            "frames": self._frames,
            "unreadable": self._unreadable,
            "damaged": self._port.damaged,
            "opened": self._port.opened,
        }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the driver until Ctrl-C."""
    return node.run(SerialCamera, argv, frames=True)


if __name__ == "__main__":
    raise SystemExit(main())
