"""The bed is denser in some places than in others."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class PhiNonuniformity(Effect):
    """The average over k(φ) is taken after the chain (see ``likelihood``).

    Every step takes half a period, so speed is a plain average; lift is the median step's, peak the best step's.
    """

    identifier = "phi_nonuniformity"
    stage = "strength"
    formula = "sigma -> hypot(sigma, sigma_phi): v averaged over phi ~ N(phi, sigma)"
    source = "Li09, air flow uniform to 10 %"
    seen_in = "replicate scatter near omega_c"
    control = "measure φ at several places along the track"
    parameters = (
        Parameter("sigma_phi", "1", 0.001, 0.004, 0.002, "spread of φ along the track", neutral=0.0, hard_low=0.0),
    )

    along_the_track = True

    def apply(self, chain: Chain, p: Values) -> None:
        chain.sigma_phi = np.hypot(chain.sigma_phi, p["sigma_phi"])
