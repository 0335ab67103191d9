"""The body slides on after its belly has come down."""

import numpy as np

from sandbot_model.chain import Chain, Effect, Parameter, Values


class BellyCoast(Effect):
    """It leaves the leg circle at βω(d + h - R) and friction stops it."""

    identifier = "belly_coast"
    stage = "step"
    formula = "s += (beta omega (d + h - R))^2/(2 mu_b g)"
    source = "friction decay of the speed at touch-down"
    seen_in = "W decay; high omega"
    parameters = (Parameter("mu_b", "1", 0.3, 1.5, 0.7, "friction coefficient of the belly on grains", hard_low=0.02),)

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        robot = chain.robot
        touch_down = (
            chain.slow_phase_ratio
            * chain.omega
            * np.maximum(chain.depth + robot.axle_height_m - robot.leg_radius_m, 0.0)
        )
        chain.step = chain.step + touch_down**2 / (2 * p["mu_b"] * robot.gravity_m_s2)
