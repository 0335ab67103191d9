"""Parameters of the scene node, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass

from sandbot_common import cli
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class SceneParameters:
    """What is drawn for RViz, and how often."""

    rate_hz: float = parameter(20.0, unit="Hz", doc="pictures of the scene a second", low=0.1, high=100.0)
    cameras: str = parameter("", doc="cameras file, for the cameras' poses; empty: the project's own")
    robot: str = parameter("", doc="robot file; empty: SandBot, or the robot in /trial")


main = cli.node("sandbot_bringup.nodes.scene_node", SceneParameters)

if __name__ == "__main__":
    raise SystemExit(main())
