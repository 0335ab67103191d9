"""The cable holds back, the leg creeps."""

import numpy as np

from sandbot_model.physics.chain import Chain, horizontal_force
from sandbot_model.physics.effect import Effect, Parameter, Values


class CableDrag(Effect):
    """The leg yields in proportion to the drag over the horizontal force that the ground can give."""

    identifier = "cable_drag"
    stage = "step"
    formula = "s -> s*e; peak -> peak*e; e = clip(1 - F_c/F_x, 0, 1); F_x = 1.5*alpha_x*w*d^2; alpha_x = 146e3 [N/m^3]"
    source = "Li09, rails and cable"
    seen_in = "s and W peak lower at the same L"
    control = "carry the cable along, or unhook it: its drag vanishes"
    parameters = (
        Parameter(
            "f_c_n", "N", 0.05, 0.5, 0.2, "drag of the cable on one leg", neutral=0.0, hard_low=0.0, symbol="F_c"
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        grip = np.clip(1 - p["f_c_n"] / horizontal_force(chain), 0.0, 1.0)
        chain.creep(grip)
