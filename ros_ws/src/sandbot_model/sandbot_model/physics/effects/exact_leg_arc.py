"""The ground pushes on a circular arc, not on a flat foot."""

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Values


class ExactLegArc(Effect):
    """Local pressure αz integrated over the wetted arc of the c-leg; the primitive is odd in ψ."""

    identifier = "exact_leg_arc"
    stage = "balance"
    formula = (
        "F -> F*(P(psi_max) + P(psi_min))/z; P(psi) = R/2*(psi + cos(psi)*sin(psi)) + (z - R)*sin(psi); "
        "psi_max = acos(1 - z/R); psi_min = min(psi_max, acos((d + h)/R - 1) + Delta_xi)"
    )
    source = "Li09, full model; physics §3"
    seen_in = "v, L; d > 3.5 cm"

    def apply(self, chain: Chain, p: Values) -> None:  # noqa: ARG002
        robot = chain.robot
        radius = robot.leg_radius_m
        # The ground begins at z; the leg's posture follows from its depth.
        z = np.clip(chain.penetration, 1e-9, 2 * radius)
        psi_max = np.arccos(np.clip(1 - z / radius, -1.0, 1.0))
        tip = np.arccos(np.clip((chain.depth + robot.axle_height_m) / radius - 1, -1.0, 1.0)) + robot.arc_excess_rad
        psi_min = np.minimum(psi_max, tip)
        arc = _primitive(psi_max, z, radius) + _primitive(psi_min, z, radius)
        chain.force = chain.force * arc / z


def _primitive(psi: Floats, z: Floats, radius: float) -> Floats:
    """(R/2)(ψ + cos ψ sin ψ) + (z - R) sin ψ [m]."""
    primitive: Floats = 0.5 * radius * (psi + np.cos(psi) * np.sin(psi)) + (z - radius) * np.sin(psi)
    return primitive
