"""A cone of grains is accelerated with the leg."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values

GRAIN_DENSITY = 1000.0
"""ρ_g of poppy seeds [kg/m³]."""
CONE_ANGLE = np.deg2rad(60.0)
"""θ_c."""


class AddedMass(Effect):
    """It adds to the inertial term only, not to the weight."""

    identifier = "added_mass"
    stage = "balance"
    formula = "m_a -> m_a + c_g*phi*rho_g*pi/3*(w*R/pi)^1.5*tan(theta_c); rho_g = 1000 [kg/m^3]; theta_c = pi/3"
    source = "Aguilar & Goldman 2016"
    seen_in = "T only; about 0.6 % of m"
    parameters = (Parameter("c_g", "1", 2.0, 3.5, 2.7, "added mass coefficient", neutral=0.0, hard_low=0.0),)

    def apply(self, chain: Chain, p: Values) -> None:
        robot = chain.robot
        cone = np.pi / 3 * (robot.leg_width_m * robot.leg_radius_m / np.pi) ** 1.5 * np.tan(CONE_ANGLE)
        chain.added_mass = chain.added_mass + p["c_g"] * chain.phi * GRAIN_DENSITY * cone
