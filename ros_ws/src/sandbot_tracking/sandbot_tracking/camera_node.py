"""The camera node: a video file or device to image_raw and camera_info."""

from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from sandbot_common import messages, node, topics
from sandbot_common.errors import InputError
from sandbot_common.parameters import parameter
from sandbot_tracking.calibration import Camera, read_cameras
from sandbot_tracking.source import Source

_TOPICS = {
    "dorsal": (topics.DORSAL_IMAGE, topics.DORSAL_INFO),
    "lateral": (topics.LATERAL_IMAGE, topics.LATERAL_INFO),
}


@dataclass(frozen=True)
class CameraParameters:
    """Which camera, from where."""

    camera: str = parameter("dorsal", doc="which of the two cameras this is", choices=tuple(_TOPICS))
    video: str = parameter("", doc="video file, or number of the camera device")
    cameras: str = parameter("", doc="YAML file of the calibrated cameras; empty: no camera_info")
    rate_hz: float = parameter(0.0, unit="Hz", doc="frames per second; 0: as the video says", low=0.0, high=10000.0)


class CameraNode(Node):
    """Publishes one source frame by frame."""

    def __init__(self) -> None:
        super().__init__("camera")
        given = node.Parameters(self, CameraParameters, _fixed).current
        if not given.video:
            raise InputError("camera parameters: video: give a file or device, --ros-args -p video:=dorsal.avi")
        self._name = given.camera
        self._info = _info(read_cameras(given.cameras), given.camera) if given.cameras else None
        self._source = Source(given.video)
        rate_hz = given.rate_hz or self._source.rate_hz or 100.0
        image, info = _TOPICS[given.camera]
        self._image, self._camera_info = node.publisher(self, image), node.publisher(self, info)
        self._frames = 0
        self._health = node.Health(self, lambda: {"frames": self._frames, "rate_hz": rate_hz})
        self._timer = self.create_timer(1.0 / rate_hz, self._next)

    def _next(self) -> None:
        frame = self._source.read()
        if frame is None:
            self._timer.cancel()
            self._health.text = "the video has ended"
            return
        now = self.get_clock().now().nanoseconds
        self._frames += 1
        self._image.publish(messages.image(now, self._name, frame))
        if self._info is not None:
            self._info.header = messages.header(now, self._name)
            self._camera_info.publish(self._info)

    def close(self) -> None:
        """Release the device."""
        self._source.close()


def _info(cameras: dict[str, Camera], name: str) -> CameraInfo:
    if name not in cameras:
        raise InputError(f"camera parameters: cameras: no {name!r} in it; known: {', '.join(cameras)}")
    camera = cameras[name]
    return messages.camera_info(0, name, (camera.width, camera.height), camera.matrix, camera.distortion)


def _fixed(_: CameraParameters) -> None:
    raise InputError("the source is opened at the start: restart the camera node to change it")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the camera node."""
    return node.run(CameraNode, argv, frames=True)
