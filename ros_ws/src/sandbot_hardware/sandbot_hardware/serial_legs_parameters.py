"""Parameters of the serial legs driver, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass

from sandbot_common import cli
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class SerialLegsParameters:
    """The line to the controller, and its lease."""

    device: str = parameter("/dev/ttyUSB1", doc="serial line of the leg controller")
    baud: int = parameter(921600, unit="Bd", doc="speed of the line", low=9600, high=12_000_000)
    robot: str = parameter("", doc="robot file, for the order of the legs on the wire; empty: SandBot's")
    legs_lease_s: float = parameter(0.25, unit="s", doc="set-points later than this stop the legs", low=0.02, high=1.0)


main = cli.node("sandbot_hardware.nodes.serial_legs_node", SerialLegsParameters)

if __name__ == "__main__":
    raise SystemExit(main())
