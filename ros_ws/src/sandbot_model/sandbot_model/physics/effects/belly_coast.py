"""The body slides on after its belly has come down."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class BellyCoast(Effect):
    """It starts at the speed of the stance's mean leg rate; friction stops it, or the next leg that stands."""

    identifier = "belly_coast"
    stage = "step"
    formula = "s -> s + u*t - mu_b*g*t^2/2; u = 2*asin(s_0/(2*R))/t_s*max(d + h - R, 0); t = min(u/(mu_b*g), t_left)"
    source = "friction decay of the speed at touch-down"
    seen_in = "W decay; high omega"
    control = "cover the belly with a slippery film: it coasts farther"
    parameters = (Parameter("mu_b", "1", 0.3, 1.5, 0.7, "friction coefficient of the belly on grains", hard_low=0.02),)
    first_step_differs = True

    def apply(self, chain: Chain, p: Values) -> None:
        robot = chain.robot
        below = np.maximum(chain.depth + robot.axle_height_m - robot.leg_radius_m, 0.0)
        touch_down = 2 * chain.stance / chain.standing_time * below
        friction = p["mu_b"] * robot.gravity_m_s2
        time = np.minimum(touch_down / friction, chain.time_left)
        chain.step = chain.step + touch_down * time - 0.5 * friction * time**2
