"""The robot's numbers (physics §1)."""

import math
from dataclasses import dataclass

from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class Robot:
    """SandBot by default; another robot is another instance."""

    leg_radius_m: float = parameter(0.0355, unit="m", doc="c-leg radius R", low=1e-3, high=1.0)
    axle_height_m: float = parameter(0.025, unit="m", doc="axle height h above the flat belly", low=0.0, high=1.0)
    leg_width_m: float = parameter(0.012, unit="m", doc="leg width w", low=1e-4, high=1.0)
    arc_excess_rad: float = parameter(
        math.pi / 4, unit="rad", doc="c-leg arc beyond a half circle Δξ", low=0.0, high=3.1
    )
    mass_per_leg_kg: float = parameter(0.767, unit="kg", doc="mass a stance leg carries m", low=1e-3, high=1e3)
    gravity_m_s2: float = parameter(9.81, unit="m/s²", doc="g", low=0.01, high=100.0)
    bed_depth_m: float = parameter(0.10, unit="m", doc="depth of the bed D", low=0.01, high=10.0)
    stiffness_depth_m: float = parameter(
        0.039, unit="m", doc="depth d_r at which force laws are tied", low=1e-3, high=1.0
    )

    @property
    def deepest_m(self) -> float:
        """2R - h: the depth at which the step has shrunk to nothing and the robot swims."""
        return 2 * self.leg_radius_m - self.axle_height_m

    @property
    def critical_k_n_per_m(self) -> float:
        """The stiffness that just carries the weight at the deepest depth, mg/(2R - h)."""
        return self.mass_per_leg_kg * self.gravity_m_s2 / self.deepest_m


SANDBOT = Robot()
"""The robot of Li09."""
