"""In stance the legs turn as the clock says, not at the mean rate."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class SlowPhaseSpeed(Effect):
    """The body is brought to βRω, β of the gait, and reaches ρRω while the leg stands.

    Before its slow phase begins, at the depth d_slow, a leg turns at the swing rate: where the ground holds only at the
    slow one the step is the chord of the slow phase, however strong the ground. ρ is β where the whole stance lies in
    the slow phase; a stance that outlasts it (SGCS is slow until θ = 0.05 rad, a leg stands until asin(s/2R)) ends at
    the swing rate, ρ = (2π - θ_s)/(2π(1 - d_c)) = 1.5. The peak of v_x(t) tells which; where no step is cut short, the
    mean speed can't (Δt → βΔt).
    """

    identifier = "slow_phase_speed"
    stage = "balance"
    formula = "Delta_v -> Delta_v*where(d < d_slow, beta_swing, beta); peak -> rho*peak"
    source = "the clock: beta = theta_s/(2 pi d_c)"
    clocked = True
    seen_in = "W peak"
    parameters = (
        Parameter(
            "rho", "1", 0.2, 1.6, 0.9, "largest leg rate in stance over the mean rate", neutral=1.0, hard_low=0.05
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        swings = chain.depth < chain.slow_begin
        chain.delta_v = chain.delta_v * np.where(swings, chain.swing_ratio, chain.slow_phase_ratio)
        chain.peak_ratio = chain.peak_ratio * p["rho"]
