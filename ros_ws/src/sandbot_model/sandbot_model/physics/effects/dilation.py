"""Disturbing dilates dense ground and compacts loose ground."""

from sandbot_model.physics.chain import Chain, disturbed_fraction
from sandbot_model.physics.effect import Effect, Parameter, Values

S_C = 0.95
"""Step over R below which a leg lands in disturbed ground (Li09: 0.9-1)."""


class Dilation(Effect):
    """Where the leg lands in disturbed ground, its stiffness is that of a volume fraction nearer to φ_c."""

    identifier = "dilation"
    stage = "strength"
    formula = (
        "k -> k + (K(phi_d) - K(phi))*clip((0.95*R - a)/(0.1*R), 0, 1); phi_d = phi + xi*(phi_c - phi): "
        "not in the first step"
    )
    source = "Gravish et al. 2010"
    seen_in = "sign flips at phi_c"
    control = "press a leg in and film the surface: dense ground rises, loose ground sinks"
    parameters = (
        Parameter(
            "xi",
            "1",
            0.3,
            1.0,
            0.6,
            "fraction of the way to phi_c by which disturbance changes φ",
            neutral=0.0,
            hard_low=0.0,
            hard_high=1.2,
        ),
        Parameter(
            "phi_c",
            "1",
            0.59,
            0.61,
            0.60,
            "volume fraction that disturbance does not change",
            hard_low=0.55,
            hard_high=0.64,
        ),
    )
    first_step_differs = True

    def apply(self, chain: Chain, p: Values) -> None:
        if not chain.first_step:
            share = disturbed_fraction(chain, S_C)
            phi_d = chain.phi + p["xi"] * (p["phi_c"] - chain.phi)
            # A difference of the fitted curve, so that it applies to the k being tried.
            chain.k = chain.k + share * (chain.k_of_phi(phi_d) - chain.k_of_phi(chain.phi))
