"""The lone middle leg of a tripod carries more and goes under first."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values
from sandbot_model.physics.geometry import deepest_m


class UnequalLegLoad(Effect):
    """At equal stiffness it sinks (1 + x) times as deep; the tripod fails when it reaches 2R - h."""

    identifier = "unequal_leg_load"
    stage = "strength"
    formula = "k -> where((1 + x)*z > 2*R - h, 0, k): the middle leg carries m (1 + x)"
    source = "statics of a 2+1 tripod"
    seen_in = "P; early collapse"
    control = "weigh what each leg carries: the middle one carries more"
    parameters = (
        Parameter("x", "1", 0.0, 0.5, 0.15, "surplus load of the middle leg", neutral=0.0, hard_low=0.0, hard_high=1.0),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        """Apply the formula; a leg pressed alone shares its load with no other."""
        if chain.one_leg:
            return
        middle = chain.penetration * (1 + p["x"])
        # The depths end at 2R - h; the tolerance keeps x = 0 identical to the base model.
        chain.k = np.where(middle > deepest_m(chain.robot) * (1 + 1e-12), 0.0, chain.k)
