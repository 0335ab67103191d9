"""A shallow leg slips back through the grains."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class LegSlip(Effect):
    """The fraction of motion lost falls with the square of depth; it lowers the step and the peak speed alike."""

    identifier = "leg_slip"
    stage = "step"
    formula = "s -> s*e; peak -> peak*e; e = clip(1 - sigma_s*(d_r/d)^2, 0, 1)"
    source = "circular slipping, Li09"
    seen_in = "s and W peak; shallow d"
    control = "glue grains to the legs: rough legs slip less"
    parameters = (
        Parameter(
            "sigma", "1", 0.0, 0.2, 0.1, "slip at depth d_r", neutral=0.0, hard_low=0.0, hard_high=0.9, symbol="sigma_s"
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        depth = np.maximum(chain.depth, 1e-6)
        grip = np.clip(1 - p["sigma"] * (chain.robot.stiffness_depth_m / depth) ** 2, 0.0, 1.0)
        chain.creep(grip)
