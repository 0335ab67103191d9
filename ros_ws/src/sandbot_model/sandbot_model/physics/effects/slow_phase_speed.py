"""In stance the legs turn as the clock says, not at the mean rate."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values
from sandbot_model.physics.gait import SEEN_RAD

NEVER = 1e3
"""A leg rate, over the mean, at which no ground holds."""


class SlowPhaseSpeed(Effect):
    """The body is brought to βRω, with the gait's β, and reaches at most ρRω while the leg stands.

    No step takes longer than half a period, after which the next leg takes hold (``Chain.longest_step``; HGCS).
    Above d_slow, the depth at which its slow phase begins, a leg turns at the swing rate. Where the ground holds only
    at the slow rate, the step is the chord of the slow phase, however strong the ground. In the first step no leg is
    above d_slow: it starts as its slow phase begins.

    A stance within the slow phase (deeper than d_slow and d_end) has its peak speed at β. One that outlasts the slow
    phase has it at the swing rate, right after the slow phase: β_swing cos θ, fully seen once the stance extends
    0.1 rad further. ρ is defined for the usual stance: within the slow phase if that reaches beyond 0.375 rad (half a
    long stance) to either side, else one that outlasts it (on SandBot's own mount SGCS is slow until θ = 0.05 rad:
    ρ = 1.5). The other kind follows from the ratio of the rates. The peak of v_x(t) separates the two; the mean speed
    can't where no step is cut short (Δt → βΔt).
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
    control = "walk in a gait of another slow-phase rate: the base model's Δt changes with it"
    parameters = (
        Parameter(
            "rho", "1", 0.2, 2.0, 0.9, "largest leg rate in stance over the mean rate", neutral=1.0, hard_low=0.05
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        swing = NEVER if chain.first_step else chain.swing_ratio
        chain.delta_v = chain.delta_v * np.where(chain.depth < chain.slow_begin, swing, chain.slow_phase_ratio)
        faster = np.maximum(chain.swing_ratio * np.cos(chain.slow_reach) / chain.slow_phase_ratio, 1.0)
        beyond = chain.stance - chain.slow_reach
        share = np.clip(beyond / SEEN_RAD, 0.0, 1.0)
        chain.peak_ratio = (
            chain.peak_ratio * p["rho"] * (1 + (faster - 1) * share) / np.where(chain.stands_slowly, 1.0, faster)
        )
