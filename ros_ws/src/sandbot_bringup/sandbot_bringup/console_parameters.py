"""Parameters of the console node, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass

from sandbot_common import cli
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class ConsoleParameters:
    """The console's settings."""

    port: int = parameter(8060, doc="TCP port of the page on this host; 0: any free one", low=0, high=65535)
    picture_rate_hz: float = parameter(5.0, unit="Hz", doc="pictures a second of each camera", low=0.1, high=25.0)
    cameras: str = parameter("", doc="cameras file, to draw the marks with; empty: the project's own")
    explorer_port: int = parameter(8050, doc="port of the explorer that the page links to", low=1, high=65535)


main = cli.node("sandbot_bringup.nodes.console_node", ConsoleParameters)

if __name__ == "__main__":
    raise SystemExit(main())
