"""Parameters of a ground that resists motion instead of taking hold; `resistive_kernel` has its mechanics."""

from dataclasses import dataclass

from sandbot_common.parameters import parameter

PHI = 0.6
"""Volume fraction at which the parameters hold."""


@dataclass(frozen=True)
class ResistiveGround:
    """The section ``resistive`` of world.yaml; with the defaults SandBot walks on dense ground and slides elsewhere."""

    strength_n_per_m3: float = parameter(
        9e5, unit="N/m³", doc="stress per depth on virgin ground at φ = 0.6", low=1e4, high=1e7
    )
    strength_per_phi: float = parameter(5.0, doc="relative change of that stress with φ", low=-20.0, high=20.0)
    softened: float = parameter(
        0.45, doc="fraction of the strength left in sheared ground at φ = 0.6", low=0.0, high=1.0
    )
    softened_per_phi: float = parameter(2.0, doc="change of that fraction with φ", low=-5.0, high=5.0)
    shear_m: float = parameter(0.01, unit="m", doc="shear in which most of the softening happens", low=1e-4, high=1.0)
    tangential: float = parameter(0.3, doc="resistance along an element over that across it", low=0.0, high=2.0)
    yield_speed_m_s: float = parameter(
        0.05, unit="m/s", doc="speed above which grains resist fully", low=0.01, high=1.0
    )
    belly_friction: float = parameter(1.5, doc="coefficient of friction of the belly", low=0.0, high=10.0)
    patch_sd: float = parameter(
        0.03, doc="relative scatter of the strength from place to place, times noise.scale", low=0.0, high=0.5
    )
    patch_m: float = parameter(0.02, unit="m", doc="length of a patch of equal strength", low=0.002, high=1.0)
