"""Only the vertical part of the acceleration has to be carried."""

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Values


class ExactVerticalAcceleration(Effect):
    """The body moves along the leg circle: of the acceleration Rω/Δt, the fraction sin θ = s/2R is vertical."""

    identifier = "exact_vertical_acceleration"
    stage = "balance"
    formula = "a_z -> a_z*s_0/(2*R)"
    source = "Li09, full model; physics §3"
    seen_in = "v, L at high omega"

    def apply(self, chain: Chain, p: Values) -> None:  # noqa: ARG002
        chain.lift_ratio = chain.lift_ratio * chain.chord / (2 * chain.robot.leg_radius_m)
