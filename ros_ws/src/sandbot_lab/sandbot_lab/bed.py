"""The virtual fluidised bed: blower level in, height of the bed out; its true volume fraction is hidden.

After fluidisation φ = 0.580. Each short pulse packs towards 0.633 by a random amount, so a target can be overshot
(Li09: 0.1 s pulses). Height = M/(ρ A φ).
"""

from dataclasses import dataclass

import numpy as np

from sandbot_common.errors import InputError
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class LabBedParameters:
    """The bed and its sensor."""

    mass_kg: float = parameter(79.75, unit="kg", doc="mass of the grains", low=0.1, high=1e4)
    grain_density_kg_m3: float = parameter(1100.0, unit="kg/m3", doc="density of a grain", low=100.0, high=1e4)
    area_m2: float = parameter(1.25, unit="m2", doc="area of the trackway", low=0.01, high=100.0)
    phi_loose: float = parameter(0.580, doc="volume fraction after fluidisation", low=0.5, high=0.65)
    phi_close: float = parameter(0.633, doc="volume fraction after many pulses", low=0.55, high=0.7)
    pulse_s: float = parameter(0.1, unit="s", doc="length of a usual pulse", low=0.01, high=1.0)
    pulses: float = parameter(25.0, doc="usual pulses that pack 63 % of the way", low=1.0, high=1000.0)
    efficiency_sd: float = parameter(0.3, doc="spread of a pulse's effect (of its logarithm)", low=0.0, high=1.0)
    loose_sd: float = parameter(0.0005, doc="spread of the loose state", low=0.0, high=0.01)
    fluidise_s: float = parameter(0.5, unit="s", doc="air for longer than this fluidises the bed", low=0.1, high=10.0)
    sensor_sd_m: float = parameter(1e-4, unit="m", doc="noise of one height reading", low=0.0, high=0.01)


class LabBed:
    """A bed with its blower and height sensor; all randomness comes from ``seed``."""

    def __init__(self, seed: int, phi: float | None = None) -> None:
        """The bed as the last trial left it: at ``phi``, by default somewhere between loose and close."""
        self.parameters = LabBedParameters()
        # The sensor has its own random stream: how often it is read must not change how the grains pack.
        self._rng, self._sensor = (np.random.default_rng([seed, 0xBED, stream]) for stream in range(2))
        p = self.parameters
        self._phi = float(self._rng.uniform(p.phi_loose, p.phi_close)) if phi is None else phi
        self._level, self._blown_s, self._t_s = 0.0, 0.0, 0.0

    @property
    def phi(self) -> float:
        """The true volume fraction, for the lab only."""
        return self._phi

    @property
    def height_m(self) -> float:
        """The true height of the bed at rest."""
        p = self.parameters
        return p.mass_kg / (p.grain_density_kg_m3 * p.area_m2 * self._phi)

    def set_blower(self, level: float) -> None:
        """Set the air flow, 0 (off) to 1. Raises InputError outside."""
        if not 0.0 <= level <= 1.0:
            raise InputError(f"blower: {level} is outside [0, 1]")
        self._settle_if_over(level)
        self._level = float(level)

    def advance(self, dt_s: float) -> None:
        """Let time pass. Raises InputError if it runs backwards."""
        if not dt_s >= 0.0:
            raise InputError(f"bed: time step {dt_s} s is not >= 0")
        self._t_s += dt_s
        if self._level > 0.0:
            self._blown_s += dt_s

    def read_height_m(self) -> float:
        """One reading of the height sensor; a fluidised bed is a little higher and its surface bubbles."""
        fluid = self._level if self._blown_s > self.parameters.fluidise_s else 0.0
        bubbles = 0.002 * fluid * self._sensor.standard_normal()
        noise = self.parameters.sensor_sd_m * self._sensor.standard_normal()
        return float(self.height_m + 0.004 * fluid + bubbles + noise)

    def _settle_if_over(self, level: float) -> None:
        """Change φ when the air stops: by fluidisation or by a pulse."""
        if level > 0.0 or self._blown_s == 0.0:
            return
        p = self.parameters
        if self._blown_s > p.fluidise_s:
            self._phi = p.phi_loose + p.loose_sd * float(self._rng.standard_normal())
        else:
            usual = self._blown_s / p.pulse_s / p.pulses
            strength = usual * float(np.exp(p.efficiency_sd * self._rng.standard_normal()))
            self._phi += (p.phi_close - self._phi) * -float(np.expm1(-strength))
        self._blown_s = 0.0
