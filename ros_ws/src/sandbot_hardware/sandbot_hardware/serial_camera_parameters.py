"""Parameters of the serial camera driver, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass

from sandbot_common import cli, topics
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class SerialCameraParameters:
    """Which camera, and its line."""

    camera: str = parameter("dorsal", doc="which of the two cameras this is", choices=tuple(topics.VIEWS))
    device: str = parameter("/dev/ttyACM0", doc="serial line of the camera")
    baud: int = parameter(921600, unit="Bd", doc="speed of the line; ignored by USB", low=9600, high=12_000_000)
    cameras: str = parameter("", doc="YAML file of the calibrated cameras; empty: no camera_info")


main = cli.node("sandbot_hardware.nodes.serial_camera_node", SerialCameraParameters)

if __name__ == "__main__":
    raise SystemExit(main())
