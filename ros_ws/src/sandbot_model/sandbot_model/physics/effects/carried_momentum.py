"""The body has not quite stopped when the next leg takes hold."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class CarriedMomentum(Effect):
    """The ground has to supply only the missing speed."""

    identifier = "carried_momentum"
    stage = "balance"
    formula = "Delta_v -> max(Delta_v - chi_m*v, 0): not in the first step"
    source = "momentum kept between steps"
    seen_in = "W trough"
    parameters = (
        Parameter(
            "chi_m",
            "1",
            0.0,
            1.0,
            0.5,
            "fraction of the mean speed that remains at the next step",
            neutral=0.0,
            hard_low=0.0,
            hard_high=1.5,
        ),
    )
    first_step_differs = True

    def apply(self, chain: Chain, p: Values) -> None:
        if not chain.first_step:
            chain.delta_v = np.maximum(chain.delta_v - p["chi_m"] * chain.speed, 0.0)
