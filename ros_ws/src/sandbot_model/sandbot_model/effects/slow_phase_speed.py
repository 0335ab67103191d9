"""In stance the legs turn at the slow-phase rate, not at the mean one."""

from sandbot_model.chain import Chain, Effect, Parameter, Values


class SlowPhaseSpeed(Effect):
    """The body is brought to βRω, and βRω is the peak of v_x(t)."""

    identifier = "slow_phase_speed"
    stage = "balance"
    formula = "dv = beta R omega instead of R omega"
    source = "the clock: beta = theta_s/(2 pi d_c)"
    seen_in = "W peak only: v cannot see it (dt -> beta dt)"
    parameters = (
        Parameter(
            "beta",
            "1",
            0.2,
            1.0,
            0.389,
            "leg rate in stance over the mean rate",
            neutral=1.0,
            hard_low=0.05,
            hard_high=1.0,
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        chain.leg_speed, chain.delta_v = chain.leg_speed * p["beta"], chain.delta_v * p["beta"]
