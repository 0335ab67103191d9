"""Parameters of the clock node, and its command line; neither needs ROS loaded."""

from dataclasses import dataclass
from typing import Any

from sandbot_clock.gait import PRESETS, Gait
from sandbot_common import cli
from sandbot_common.parameters import parameter, specs

CUSTOM = "CUSTOM"


def _of_gait(name: str) -> Any:
    # A field of Gait with its bounds, as a parameter of the node.
    spec = next(spec for spec in specs(Gait) if spec.name == name)
    default = getattr(PRESETS["SGCS"], name)
    return parameter(default, unit=spec.unit, doc=f"{spec.doc}; of gait CUSTOM", low=spec.low, high=spec.high)


@dataclass(frozen=True)
class ClockParameters:
    """Parameters of the clock node."""

    omega_rad_s: float = parameter(8.0, unit="rad/s", doc="mean leg rate ω; may change while running", low=0, high=60)
    gait: str = parameter("SGCS", doc="clock signal; may change while running", choices=(*PRESETS, CUSTOM))
    theta_s_rad: float = _of_gait("theta_s_rad")
    theta_0_rad: float = _of_gait("theta_0_rad")
    duty: float = _of_gait("duty")
    rate_hz: float = parameter(200.0, unit="Hz", doc="set-points a second, from the next start on", low=20, high=1000)
    autostart: bool = parameter(False, doc="start by itself, one second after the node")
    max_run_s: float = parameter(30.0, unit="s", doc="longest run; a campaign sets its trial's", low=0.1, high=20000)
    lease_s: float = parameter(0.25, unit="s", doc="an /operator/lease later than this stops", low=0.02, high=1.0)
    robot_s: float = parameter(0.25, unit="s", doc="/leg_states silent for longer stop the legs", low=0.02, high=1.0)
    robot: str = parameter("", doc="robot file; empty: SandBot, or the robot in /trial")
    late_s: float = parameter(0.1, unit="s", doc="a set-point later than this stops the legs", low=0.005, high=0.25)

    @property
    def gait_used(self) -> Gait:
        """The named preset, or the three gait parameters if it is CUSTOM."""
        if self.gait == CUSTOM:
            return Gait(self.theta_s_rad, self.theta_0_rad, self.duty)
        return Gait.from_name(self.gait)


main = cli.node("sandbot_clock.nodes.clock_node", ClockParameters)

if __name__ == "__main__":
    raise SystemExit(main())
