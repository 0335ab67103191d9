"""Fast legs have to throw grains out of the way."""

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values

BULK_DENSITY = 600.0
"""ρ_b of poppy seeds [kg/m³]."""


class InertialDrag(Effect):
    """A force ∝ speed² in addition to the one ∝ depth."""

    identifier = "inertial_drag"
    stage = "balance"
    formula = "F_z -> F_z + lambda_1*rho_b*w*R*(R*omega)^2; rho_b = 600 [kg/m^3]"
    source = "Katsuragi & Durian 2007"
    seen_in = "v, T; omega > 20 rad/s"
    control = "hold the body and turn the legs in the ground: the force on it grows with ω²"
    parameters = (Parameter("lambda_1", "1", 0.5, 2.0, 1.0, "drag coefficient", neutral=0.0, hard_low=0.0),)

    def apply(self, chain: Chain, p: Values) -> None:
        robot = chain.robot
        area = robot.leg_width_m * robot.leg_radius_m
        chain.extra_force = (
            chain.extra_force + p["lambda_1"] * BULK_DENSITY * area * (robot.leg_radius_m * chain.omega) ** 2
        )
