"""The volume fraction of the bed and how well it is known (Li09, methods)."""

import math
from dataclasses import dataclass

from sandbot_common.errors import InputError


@dataclass(frozen=True)
class Measured:
    """A positive quantity and its standard uncertainty, both in the same unit. Raises InputError otherwise."""

    value: float
    sd: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.value) and self.value > 0):
            raise InputError(f"measured value {self.value} is not a finite number > 0")
        if not (math.isfinite(self.sd) and self.sd >= 0):
            raise InputError(f"uncertainty {self.sd} of {self.value} is not a finite number >= 0")

    @property
    def relative_sd(self) -> float:
        """σ_x / x."""
        return self.sd / self.value


def volume_fraction(mass_kg: Measured, density_kg_m3: Measured, area_m2: Measured, height_m: Measured) -> Measured:
    """φ = M/(ρ A height), with σ_φ/φ = √[(σ_M/M)² + (σ_ρ/ρ)² + (σ_A/A)² + (σ_h/height)²].

    ``density_kg_m3`` is that of a grain, not of the bed. The first three are the same in every trial of a campaign, so
    only the height's contribution to σ_φ varies between trials.
    """
    phi = mass_kg.value / (density_kg_m3.value * area_m2.value * height_m.value)
    parts = (mass_kg, density_kg_m3, area_m2, height_m)
    return Measured(phi, phi * math.hypot(*(part.relative_sd for part in parts)))
