"""The body slides on after its belly has come down."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values
from sandbot_model.physics.geometry import stance_angle


class BellyCoast(Effect):
    """It leaves the leg circle at βω(d + h - R) and friction stops it."""

    identifier = "belly_coast"
    stage = "step"
    formula = (
        "s -> s + u*t - mu_b*g*t^2/2; u = beta*omega*max(d + h - R, 0); t = min(u/(mu_b*g), t_left/(1 + first)); "
        "t_left = max(pi/omega - 2*asin(s_0/(2*R))/(beta*omega), 0): first is 1 in the first step and 0 in all others"
    )
    source = "friction decay of the speed at touch-down"
    seen_in = "W decay; high omega"
    parameters = (Parameter("mu_b", "1", 0.3, 1.5, 0.7, "friction coefficient of the belly on grains", hard_low=0.02),)
    first_step_differs = True

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        robot = chain.robot
        below = np.maximum(chain.depth + robot.axle_height_m - robot.leg_radius_m, 0.0)
        rate = chain.slow_phase_ratio * chain.omega
        touch_down = rate * below
        # The leg stands over the chord's angle; what is left of half a period is there to slide.
        stood = 2 * stance_angle(chain.chord, robot.leg_radius_m) / rate
        time_left = np.maximum(np.pi / chain.omega - stood, 0.0)
        if chain.first_step:
            # From a standing start half of it has gone by before the leg stands.
            time_left = time_left / 2
        friction = p["mu_b"] * robot.gravity_m_s2
        time = np.minimum(touch_down / friction, time_left)
        chain.step = chain.step + touch_down * time - 0.5 * friction * time**2
