"""A leg may land in the crater of the one before."""

import numpy as np

from sandbot_model.physics.chain import Chain, disturbed_fraction
from sandbot_model.physics.effect import Effect, Parameter, Values
from sandbot_model.physics.geometry import leg_radius_m


class CraterRefill(Effect):
    """Craters refill within τ; at high ω one is still z_0 exp(-π/ωτ) deep and the leg meets ground that much later."""

    identifier = "crater_refill"
    stage = "strength"
    formula = "z -> max(z - z_0*exp(-pi/(omega*tau))*clip((1.2*R - a)/(0.1*R), 0, 1), 0): not in the first step"
    source = "Li09, depression left by a leg"
    seen_in = "v, W; omega > omega_c"
    control = "draw a leg out of the ground and film how its crater refills"
    parameters = (
        Parameter(
            "z_0_m",
            "m",
            0.003,
            0.015,
            0.008,
            "depth of a fresh crater",
            neutral=0.0,
            hard_low=0.0,
            symbol="z_0",
            scales_with=leg_radius_m,
        ),
        Parameter("tau_s", "s", 0.05, 0.3, 0.15, "time in which it refills", hard_low=0.01, symbol="tau"),
    )
    first_step_differs = True

    def apply(self, chain: Chain, p: Values) -> None:
        if not chain.first_step:
            share = disturbed_fraction(chain, 1.2)
            crater = p["z_0_m"] * np.exp(-np.pi / (chain.omega * p["tau_s"]))
            chain.penetration = np.maximum(chain.penetration - share * crater, 0.0)
