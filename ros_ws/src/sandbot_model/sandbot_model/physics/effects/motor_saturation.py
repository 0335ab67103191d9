"""The motors do not reach the commanded rates."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values
from sandbot_model.physics.gait import duty


class MotorSaturation(Effect):
    """Legs turn slower than commanded, the more so the higher the commanded rate: each phase of the gait by its own.

    The phases take longer, so ω falls; the fast one lags most, so β rises and β_swing falls. The peak of v_x(t) is that
    of the phase in which a leg usually stands. Where legs turn at one rate this is ω → ω/√(1 + (ω/ω_s)²).
    """

    identifier = "motor_saturation"
    stage = "clock"
    formula = (
        "omega -> omega/T; beta -> beta*T/l(beta); beta_swing -> beta_swing*T/l(beta_swing); "
        "peak -> peak*T/l(where(c < cos(0.375), beta, beta_swing)); l(b) = sqrt(1 + (b*omega/omega_s)^2); "
        "T = d_c*l(beta) + (1 - d_c)*l(beta_swing); d_c = (beta_swing - 1)/(beta_swing - beta); "
        "c = (max(d_slow, d_end) + h - R)/R"
    )
    source = "Li09, motor torque and speed"
    seen_in = "encoder omega, T; high omega"
    control = "film or read the legs' angle: they turn slower than commanded"
    parameters = (
        Parameter(
            "omega_s_rad_s",
            "rad/s",
            30.0,
            300.0,
            70.0,
            "leg frequency at which the motors saturate",
            hard_low=5.0,
            hard_high=1000.0,
            symbol="omega_s",
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        slow, swing = chain.slow_phase_ratio, chain.swing_ratio
        slow_lag, swing_lag = (np.sqrt(1 + (ratio * chain.omega / p["omega_s_rad_s"]) ** 2) for ratio in (slow, swing))
        share = duty(slow, swing)
        period = share * slow_lag + (1 - share) * swing_lag
        slow_change, swing_change = period / slow_lag, period / swing_lag
        chain.omega = chain.omega / period
        chain.slow_phase_ratio, chain.swing_ratio = slow * slow_change, swing * swing_change
        chain.peak_ratio = chain.peak_ratio * np.where(chain.stands_slowly, slow_change, swing_change)
