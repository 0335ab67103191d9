"""Parameters of the bed node, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass

from sandbot_bed.protocol import ProtocolParameters
from sandbot_common import cli
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class BedParameters(ProtocolParameters):
    """Parameters of the bed node: the protocol's, the target and the pace."""

    target_phi: float = parameter(0.6, doc="volume fraction to prepare", low=0.3, high=0.74)
    rate_hz: float = parameter(100.0, unit="Hz", doc="steps a second; fixed when the node starts", low=20, high=1000)
    lease_s: float = parameter(0.45, unit="s", doc="a lease or step this late ends a preparation", low=0.1, high=2.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_target(self.target_phi)


main = cli.node("sandbot_bed.nodes.bed_node", BedParameters)

if __name__ == "__main__":
    raise SystemExit(main())
