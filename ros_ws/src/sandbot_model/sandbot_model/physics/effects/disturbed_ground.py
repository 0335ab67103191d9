"""Legs land in ground that earlier legs have disturbed."""

import numpy as np

from sandbot_model.physics.chain import Chain, disturbed_fraction
from sandbot_model.physics.effect import Effect, Parameter, Values
from sandbot_model.physics.geometry import critical_k_n_per_m


class DisturbedGround(Effect):
    """Short steps put the leg where the ground has been loosened to k_L; virgin ground is k."""

    identifier = "disturbed_ground"
    stage = "strength"
    formula = "k -> k - max(k - k_L, 0)*clip((s_c*R - a)/(0.1*R), 0, 1): not in the first step"
    source = "Li09, transition at s/R = 0.9-1"
    seen_in = "v collapse with a normal first step; phi > .6, omega > omega_c"
    control = "prepare the ground anew before every step: the collapse vanishes"
    parameters = (
        Parameter(
            "k_l_n_per_m",
            "N/m",
            165.0,
            185.0,
            175.0,
            "stiffness of disturbed ground",
            hard_low=0.0,
            symbol="k_L",
            scales_with=critical_k_n_per_m,
        ),
        Parameter(
            "s_c",
            "1",
            0.85,
            1.05,
            0.95,
            "step over R below which a leg lands in disturbed ground",
            hard_low=0.1,
            hard_high=2.0,
        ),
    )
    first_step_differs = True

    def apply(self, chain: Chain, p: Values) -> None:
        if not chain.first_step:
            share = disturbed_fraction(chain, p["s_c"])
            # Disturbance only loosens: ground that is already weaker than k_L keeps its k.
            chain.k = chain.k - np.maximum(chain.k - p["k_l_n_per_m"], 0.0) * share
