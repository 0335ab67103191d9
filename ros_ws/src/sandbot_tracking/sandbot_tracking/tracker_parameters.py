"""Parameters of the tracker node, and its command line; neither needs ROS."""

from dataclasses import dataclass

from sandbot_common import cli
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class TrackerParameters:
    """Settings of the tracker."""

    cameras: str = parameter("", doc="YAML file of the calibrated cameras (dorsal, lateral); empty: the project's own")
    robot: str = parameter("", doc="YAML file of the robot; empty: SandBot. That in /trial takes precedence")
    pair_tolerance_s: float = parameter(
        0.0, unit="s", doc="largest time between two views of one instant; 0: half a frame period", low=0.0, high=0.5
    )
    sensor_bits: int = parameter(16, doc="bits that a camera of 16-bit encoding fills", low=8, high=16)
    latency_budget_s: float = parameter(
        0.05, unit="s", doc="exposure to /speed: later is a missed deadline", low=0.001, high=10.0
    )


main = cli.node("sandbot_tracking.nodes.tracker_node", TrackerParameters)

if __name__ == "__main__":
    raise SystemExit(main())
