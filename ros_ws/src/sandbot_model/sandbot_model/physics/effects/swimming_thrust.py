"""A swimming robot is pushed by the drag on its legs."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class SwimmingThrust(Effect):
    """The advance per cycle falls as 1/ω², limited by the legs' speed; this replaces the constant v_swim."""

    identifier = "swimming_thrust"
    stage = "speed"
    formula = "v_swim -> min(A/omega, R*omega/pi)"
    source = "Li09, omega^-2 advance per cycle"
    seen_in = "v in swimming; low k, omega > omega_c"
    parameters = (Parameter("thrust_m_s2", "m/s²", 0.16, 0.48, 0.32, "A, thrust per mass", hard_low=0.0, symbol="A"),)
    replaces = ("v_swim_m_s",)

    def apply(self, chain: Chain, p: Values) -> None:
        chain.v_swim = np.minimum(p["thrust_m_s2"] / chain.omega, chain.leg_speed / np.pi)
