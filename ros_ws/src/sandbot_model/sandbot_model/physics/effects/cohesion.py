"""Moist grains stick."""

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class Cohesion(Effect):
    """A force that does not depend on depth."""

    identifier = "cohesion"
    stage = "balance"
    formula = "F_z -> F_z + 2*c*w*R"
    source = "Mohr-Coulomb"
    seen_in = "offset in F(z)"
    control = "dry the grains: it vanishes"
    parameters = (Parameter("c_pa", "Pa", 0.0, 500.0, 200.0, "cohesion", neutral=0.0, hard_low=0.0, symbol="c"),)

    def apply(self, chain: Chain, p: Values) -> None:
        chain.extra_force = chain.extra_force + 2 * p["c_pa"] * chain.robot.leg_width_m * chain.robot.leg_radius_m
