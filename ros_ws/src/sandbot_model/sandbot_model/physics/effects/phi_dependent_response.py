"""How long it takes to bring the body to leg speed depends on the volume fraction."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class PhiDependentResponse(Effect):
    """Δt is linear in the volume fraction."""

    identifier = "phi_dependent_response"
    stage = "balance"
    formula = "Delta_t -> Delta_t*max(1 + b*(phi - 0.61)/0.05, 0.05)"
    source = "Li09"
    seen_in = "omega_c(phi)"
    parameters = (Parameter("b", "1", -0.5, 1.0, 0.3, "change of Δt over 0.05 of φ", neutral=0.0, hard_low=-0.95),)

    def apply(self, chain: Chain, p: Values) -> None:
        chain.delta_t = chain.delta_t * np.maximum(1 + p["b"] * (chain.phi - 0.61) / 0.05, 0.05)
