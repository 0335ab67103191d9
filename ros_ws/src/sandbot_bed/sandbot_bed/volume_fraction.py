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

    ``density_kg_m3`` is that of a grain, not of the bed. The first three are the same in every trial of a campaign:
    between trials only the height's share of σ_φ scatters.
    """
    phi = mass_kg.value / (density_kg_m3.value * area_m2.value * height_m.value)
    parts = (mass_kg, density_kg_m3, area_m2, height_m)
    return Measured(phi, phi * math.hypot(*(part.relative_sd for part in parts)))


def density_by_displacement(mass_kg: Measured, before_m3: Measured, after_m3: Measured) -> Measured:
    """Grain density [kg/m³] from the water level before and after grains of known dry mass go in.

    ρ = M/(V₂ − V₁), with σ_ρ/ρ = √[(σ_M/M)² + (σ_V₁² + σ_V₂²)/(V₂ − V₁)²]. Raises InputError if the level did not rise.
    """
    if not after_m3.value > before_m3.value:
        raise InputError(
            f"displacement: the volume after ({after_m3.value} m3) must exceed the one before ({before_m3.value} m3)"
        )
    displaced = Measured(after_m3.value - before_m3.value, math.hypot(before_m3.sd, after_m3.sd))
    density = mass_kg.value / displaced.value
    return Measured(density, density * math.hypot(mass_kg.relative_sd, displaced.relative_sd))
