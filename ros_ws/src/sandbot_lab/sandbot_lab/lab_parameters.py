"""Parameters of the lab node, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass

from sandbot_common import cli
from sandbot_common.parameters import parameter
from sandbot_lab.world import START_X_M


@dataclass(frozen=True)
class LabParameters:
    """Parameters of the lab node."""

    world: str = parameter("", doc="sealed world file; empty: one in which nothing is hidden")
    cameras: str = parameter("", doc="cameras file; empty: the project's own")
    robot: str = parameter(
        "", doc="robot file; empty: SandBot. A robot in /trial takes precedence over it, and one in the world over both"
    )
    seed: int = parameter(1, doc="random seed of the bed", low=0, high=2**62)
    trial_seed: int = parameter(0, doc="random seed of the next trial; 0: another one each time", low=0, high=2**62)
    batch_seed: int = parameter(0, doc="random seed that the next trial shares with its batch", low=0, high=2**62)
    progress: float = parameter(0.0, doc="progress of the campaign; 1: at its last planned trial", low=0.0, high=1e3)
    phi: float = parameter(0.0, doc="volume fraction of the next trial; 0: the bed's own", low=0.0, high=0.7)
    start_x: float = parameter(START_X_M, unit="m", doc="where the robot's com starts", low=0.0, high=2.5)
    images: bool = parameter(True, doc="whether the cameras run")
    idle_frames: bool = parameter(False, doc="whether the cameras also run while the robot stands")
    legs_lease_s: float = parameter(0.25, unit="s", doc="set-points later than this stop the legs", low=0.02, high=1.0)
    air_lease_s: float = parameter(0.45, unit="s", doc="a /bed/blower later than this turns it off", low=0.05, high=2.0)


main = cli.node("sandbot_lab.nodes.lab_node", LabParameters)

if __name__ == "__main__":
    raise SystemExit(main())
