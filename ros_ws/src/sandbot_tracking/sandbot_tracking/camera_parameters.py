"""Parameters of the camera node, and its command line; neither needs ROS."""

from dataclasses import dataclass

from sandbot_common import cli, topics
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class CameraParameters:
    """Which camera, and its source."""

    camera: str = parameter("dorsal", doc="which of the two cameras this is", choices=tuple(topics.VIEWS))
    video: str = parameter("", doc="video file, or number of the camera device")
    cameras: str = parameter("", doc="YAML file of the calibrated cameras; empty: no camera_info")
    rate_hz: float = parameter(0.0, unit="Hz", doc="frames per second; 0: as the video says", low=0.0, high=10000.0)
    playback: float = parameter(
        1.0, doc="speed at which a film is played; its stamps stay film time", low=0.01, high=10.0
    )
    exposure_s: float = parameter(0.0, unit="s", doc="exposure of a device; 0: as cameras says", low=0.0, high=1.0)


main = cli.node("sandbot_tracking.nodes.camera_node", CameraParameters)

if __name__ == "__main__":
    raise SystemExit(main())
