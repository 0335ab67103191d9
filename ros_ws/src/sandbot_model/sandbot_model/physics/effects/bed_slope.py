"""The bed is not level."""

import numpy as np

from sandbot_model.physics.chain import Chain, horizontal_force
from sandbot_model.physics.effect import Effect, Parameter, Values


class BedSlope(Effect):
    """Gravity normal to the bed is slightly lower, and its component along the track makes the legs creep."""

    identifier = "bed_slope"
    stage = "balance"
    formula = (
        "g -> g*cos(chi); s -> s*e; peak -> peak*e; e = max(1 - N*m*g*sin(chi)/F_x, 0); "
        "F_x = 1.5*alpha_x*w*d^2; alpha_x = 146e3 [N/m^3]"
    )
    source = "statics on an incline"
    seen_in = "direction asymmetry"
    control = "walk the track the other way: its sign changes"
    parameters = (
        Parameter(
            "chi_rad", "rad", -0.035, 0.035, 0.01, "slope of the bed, uphill positive", neutral=0.0, symbol="chi"
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        robot = chain.robot
        downhill = robot.legs_per_tripod * robot.mass_per_leg_kg * robot.gravity_m_s2 * np.sin(p["chi_rad"])
        chain.gravity = chain.gravity * np.cos(p["chi_rad"])
        grip = np.maximum(1 - downhill / horizontal_force(chain), 0.0)
        chain.creep(grip)
