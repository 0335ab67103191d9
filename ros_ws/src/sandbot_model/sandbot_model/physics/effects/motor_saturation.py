"""The motors do not reach the commanded frequency."""

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class MotorSaturation(Effect):
    """Everything downstream sees the lower ω."""

    identifier = "motor_saturation"
    stage = "clock"
    formula = "omega -> omega/sqrt(1 + (omega/omega_s)^2)"
    source = "Li09, motor torque and speed"
    seen_in = "encoder omega, T; high omega"
    parameters = (
        Parameter(
            "omega_s_rad_s",
            "rad/s",
            30.0,
            120.0,
            70.0,
            "leg frequency at which the motors give out",
            hard_low=5.0,
            hard_high=300.0,
            symbol="omega_s",
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        chain.omega = chain.omega / np.sqrt(1 + (chain.omega / p["omega_s_rad_s"]) ** 2)
