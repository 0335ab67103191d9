"""In stance the legs turn as the clock says, not at the mean rate."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values
from sandbot_model.physics.gait import SEEN_RAD

NEVER = 1e3
"""A rate at which no ground holds."""


class SlowPhaseSpeed(Effect):
    """The body is brought to βRω, β of the gait, and reaches ρRω while the leg stands.

    No step takes longer than half a period, when the next leg takes hold (``Chain.longest_step``; HGCS).
    Before its slow phase begins, at the depth d_slow, a leg turns at the swing rate: where the ground holds only at the
    slow one the step is the chord of the slow phase, however strong the ground. In the first step no leg is there: it
    sets out as its slow phase begins.

    A stance that lies within the slow phase, deeper than where that begins and ends, has its peak at β; one that
    outlasts it, at the swing rate, there where the slow phase is left: β_swing cos θ, all of which is seen from 0.1 rad
    on. ρ is that of the usual stance: of one within a slow phase that reaches beyond 0.375 rad to either side, half a
    long stance, and of one that outlasts a narrower one (SGCS on SandBot's own mount is slow until θ = 0.05 rad: ρ =
    1.5). The other has its share of that. The peak of v_x(t) tells which; where no step is cut short, the mean speed
    can't (Δt → βΔt).
    """

    identifier = "slow_phase_speed"
    stage = "balance"
    formula = (
        "Delta_v -> Delta_v*b; b = where(d < d_slow, b_s, beta); b_s = where(first, 1e3, beta_swing); "
        "peak -> rho*peak*(1 + (q - 1)*share)/where(c < cos(0.375), 1, q); q = max(beta_swing*c/beta, 1); "
        "share = clip((asin(s_0/(2*R)) - acos(c))/0.1, 0, 1); c = (max(d_slow, d_end) + h - R)/R"
    )
    source = "the clock: beta = theta_s/(2 pi d_c)"
    clocked = at_the_slow_rate = True
    first_step_differs = True
    seen_in = "W peak"
    parameters = (
        Parameter(
            "rho", "1", 0.2, 2.0, 0.9, "largest leg rate in stance over the mean rate", neutral=1.0, hard_low=0.05
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        swing = NEVER if chain.first_step else chain.swing_ratio
        chain.delta_v = chain.delta_v * np.where(chain.depth < chain.slow_begin, swing, chain.slow_phase_ratio)
        faster = np.maximum(chain.swing_ratio * np.cos(chain.slow_reach) / chain.slow_phase_ratio, 1.0)
        beyond = chain.stance - chain.slow_reach
        share = np.clip(beyond / SEEN_RAD, 0.0, 1.0)
        chain.peak_ratio = (
            chain.peak_ratio * p["rho"] * (1 + (faster - 1) * share) / np.where(chain.stands_slowly, 1.0, faster)
        )
