"""The floor of the bed stiffens the ground above it."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class FiniteDepth(Effect):
    """Stress from the floor decays upwards over ℓ."""

    identifier = "finite_depth"
    stage = "strength"
    formula = "k -> k*(1 + exp(-(D - z)/l))"
    source = "Stone et al. 2004"
    seen_in = "L cap; deep d"
    control = "fill a deeper bed: it vanishes"
    parameters = (
        Parameter("l_m", "m", 0.01, 0.03, 0.02, "depth over which the floor is felt", hard_low=0.002, symbol="l"),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        chain.k = chain.k * (1 + np.exp(-(chain.robot.bed_depth_m - chain.penetration) / p["l_m"]))
