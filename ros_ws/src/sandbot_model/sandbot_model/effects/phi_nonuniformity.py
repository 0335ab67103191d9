"""The bed is denser in some places than in others."""

import numpy as np

from sandbot_model.chain import Chain, Effect, Parameter, Values


class PhiNonuniformity(Effect):
    """What is measured is an average over k(φ); the average is taken after the chain (see ``fit``)."""

    identifier = "phi_nonuniformity"
    stage = "strength"
    formula = "v averaged over phi ~ N(phi, sigma_phi)"
    source = "Li09, air flow uniform to 10 %"
    seen_in = "replicate scatter near omega_c"
    parameters = (
        Parameter("sigma_phi", "1", 0.001, 0.004, 0.002, "spread of φ along the track", neutral=0.0, hard_low=0.0),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        chain.sigma_phi = np.hypot(chain.sigma_phi, p["sigma_phi"])
