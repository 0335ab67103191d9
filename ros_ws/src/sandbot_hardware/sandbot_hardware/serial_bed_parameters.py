"""Parameters of the serial bed driver, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass

from sandbot_common import cli
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class SerialBedParameters:
    """The line to the bed, and its limits."""

    device: str = parameter("/dev/ttyUSB0", doc="serial line of the bed's controller")
    baud: int = parameter(115200, unit="Bd", doc="speed of the line", low=9600, high=12_000_000)
    range_low_m: float = parameter(0.02, unit="m", doc="least height the sensor sees", low=0.0, high=10.0)
    range_high_m: float = parameter(0.5, unit="m", doc="greatest height the sensor sees", low=0.0, high=10.0)
    air_lease_s: float = parameter(0.45, unit="s", doc="a /bed/blower later than this turns it off", low=0.05, high=2.0)


main = cli.node("sandbot_hardware.nodes.serial_bed_node", SerialBedParameters)

if __name__ == "__main__":
    raise SystemExit(main())
