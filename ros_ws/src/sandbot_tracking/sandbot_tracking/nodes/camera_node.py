"""The camera node: publishes a video file or device on image_raw and camera_info.

A frame's stamp is the middle of its exposure. A device's frame is stamped with the time it was received minus half the
exposure; the tracker finds the additional delay of readout and transport from the sync LED. A film's frame is stamped
by film time, k / rate after its start, however late a busy machine publishes it. A film starts once it has had a
subscriber for a second, so that no frame is missed.
"""

import time
from collections.abc import Sequence

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_common.ros.timer import Timer
from sandbot_tracking.calibration import Camera, read_cameras
from sandbot_tracking.camera_parameters import CameraParameters
from sandbot_tracking.source import Source

NAME = "camera"
SETTLE_S = 1.0


_FIXED = ros_parameters.fixed("the source is opened at the start: restart the camera node to change it")


class CameraNode(Node):
    """Publishes one source frame by frame."""

    def __init__(self) -> None:
        super().__init__(NAME)
        given = ros_parameters.Parameters(self, CameraParameters, _FIXED).current
        if not given.video:
            raise InputError("camera parameters: video: give a file or device, --ros-args -p video:=dorsal.avi")
        self._frame = topics.optical_frame(given.camera)
        camera = _camera(given.cameras, given.camera) if given.cameras else None
        self._info = _info(camera, self._frame) if camera else None
        self._half_exposure_ns = round((given.exposure_s or (camera.exposure_s if camera else 0.0)) * 5e8)
        self._source = Source(given.video)
        rate_hz = given.rate_hz or self._source.rate_hz or 100.0
        self._period_s = 1.0 / rate_hz
        self._frames = 0
        self._start_ns = 0
        self._heard_s: float | None = None
        # Told apart by their names: nodes of the usual one may be those of both views.
        sole = self.get_name() != NAME
        self._health = ros_health.Health(self, lambda: {"frames": self._frames, "rate_hz": rate_hz}, sole=sole)
        view = topics.VIEWS[given.camera]
        self._image, self._camera_info = endpoints.publisher(self, view.image), endpoints.publisher(self, view.info)
        # Reading a device blocks until its next frame: polled at twice the frame rate, the camera sets the pace.
        wait_s = self._period_s / 2 if self._source.is_device else self._period_s / given.playback
        self._timer = Timer(self, wait_s, self._next)

    def _next(self) -> None:
        if not self._health.settled:
            return  # another node may be publishing this view
        if not (self._source.is_device or self._frames or self._is_heard()):
            self._health.text = "waiting for somebody to listen"
            return
        frame = self._source.read()
        if frame is None and self._source.is_device:  # unplugged; frames resume once it is back
            self._health.level, self._health.text = 2, "the device gives no frames"
            return
        if frame is None:
            self._timer.cancel()
            self._health.text = "the video has ended"
            return
        self._health.level, self._health.text = 0, "ok"
        stamp = self._stamp_ns()
        self._frames += 1
        self._image.publish(messages.image(stamp, self._frame, frame))
        if self._info is not None:
            self._info.header = messages.header(stamp, self._frame)
            self._camera_info.publish(self._info)

    def _is_heard(self) -> bool:
        """Whether there has been a subscriber for a second, by when it has discovered this node, too."""
        if not self._image.get_subscription_count():
            self._heard_s = None
            return False
        now = time.monotonic()
        self._heard_s = self._heard_s or now
        return now - self._heard_s >= SETTLE_S

    def _stamp_ns(self) -> int:
        """The middle of the exposure of the frame just read."""
        now = int(self.get_clock().now().nanoseconds)
        if self._source.is_device:
            return now - self._half_exposure_ns
        if not self._frames:
            self._start_ns = now
        return self._start_ns + round(self._frames * self._period_s * 1e9)

    def close(self) -> None:
        """Release the device."""
        self._source.close()


def _camera(path: str, name: str) -> Camera:
    cameras = read_cameras(path)
    if name not in cameras:
        raise InputError(f"camera parameters: cameras: no {name!r} in it; known: {', '.join(cameras)}")
    return cameras[name]


def _info(camera: Camera, frame: str) -> CameraInfo:
    return messages.camera_info(0, frame, (camera.width, camera.height), camera.matrix, camera.distortion)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the camera node."""
    return node.run(CameraNode, argv, frames=True)
