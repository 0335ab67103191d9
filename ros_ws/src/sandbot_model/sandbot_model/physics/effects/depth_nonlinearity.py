"""The ground stiffens or softens with depth."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class DepthNonlinearity(Effect):
    """A power law that equals the linear one at d_r."""

    identifier = "depth_nonlinearity"
    stage = "balance"
    formula = "F -> F*(z/d_r)^(n - 1)"
    source = "Kang et al. 2018"
    seen_in = "F(z)"
    parameters = (Parameter("n", "1", 0.8, 1.5, 1.2, "exponent of the force over depth", neutral=1.0, hard_low=0.3),)

    def apply(self, chain: Chain, p: Values) -> None:
        chain.force = chain.force * np.maximum(chain.penetration / chain.robot.stiffness_depth_m, 1e-9) ** (p["n"] - 1)
