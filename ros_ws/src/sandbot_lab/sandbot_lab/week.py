"""What the trials of a real week share: a bed that differs from day to day and drifts, systematic errors of readings.

An `Occasion` says when in the campaign a trial was run; with a world's `Week` it gives the ground's strength then.
"""

import math
import zlib
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sandbot_common.parameters import parameter

T = TypeVar("T", float, NDArray[np.float64])
_DAY, _BED = 0xDA7, 0xBEDD


@dataclass(frozen=True)
class Week:
    """Batch effects and drift along a campaign, and offsets and scale errors of readings; none by default."""

    k_batch_sd: float = parameter(0.0, doc="relative scatter of k from batch to batch", low=0.0, high=0.3)
    k_preparation_sd: float = parameter(
        0.0, doc="relative scatter of k from one preparation of the bed (one trial) to the next", low=0.0, high=0.3
    )
    k_drift: float = parameter(
        0.0, doc="relative growth of k, steady in run order, by the campaign's end", low=-0.5, high=0.5
    )
    k_jump: float = parameter(0.0, doc="relative change of k at each place of k_jumps_at", low=-0.5, high=0.5)
    k_jumps_at: tuple[float, ...] = parameter(
        (0.5,), doc="where in the campaign k jumps, 0 its beginning, 1 its end", low=0.0, high=1.0
    )
    lift_zero_m: float = parameter(0.0, unit="m", doc="lift is read too high by this", low=-0.01, high=0.01)
    lift_zero_batch_sd_m: float = parameter(
        0.0, unit="m", doc="scatter of the lift's zero from batch to batch", low=0.0, high=0.01
    )
    speed_scale: float = parameter(
        0.0, doc="fraction by which distances along the track are read too long", low=-0.3, high=0.3
    )
    speed_scale_batch_sd: float = parameter(
        0.0, doc="scatter of the scale along the track from batch to batch", low=0.0, high=0.1
    )
    phi_zero: float = parameter(0.0, doc="volume fraction is read too high by this", low=-0.05, high=0.05)

    def strength(self, occasion: "Occasion") -> float:
        """Factor on k of virgin ground; exactly 1 if nothing drifts or scatters."""
        shared = self.k_batch_sd * _normal(occasion.batch_seed, _DAY, 0)
        own = self.k_preparation_sd * _normal(occasion.trial_seed, _BED, 0)
        jumps = sum(place <= occasion.progress for place in self.k_jumps_at) * math.log1p(self.k_jump)
        drift = occasion.progress * math.log1p(self.k_drift)
        return math.exp(shared + own + jumps + drift)

    def lift_offset_m(self, occasion: "Occasion") -> float:
        """Offset of the lift reading."""
        return self.lift_zero_m + self.lift_zero_batch_sd_m * _normal(occasion.batch_seed, _DAY, 1)

    def scale_error(self, occasion: "Occasion") -> float:
        """Fraction by which the dorsal camera overestimates distances along the track."""
        return self.speed_scale + self.speed_scale_batch_sd * _normal(occasion.batch_seed, _DAY, 2)


@dataclass(frozen=True)
class Occasion:
    """When in a campaign a trial is run. Trials of one batch share ``batch_seed``."""

    batch_seed: int = 0
    trial_seed: int = 0
    progress: float = 0.0
    """0 for the campaign's first trial, 1 for its last planned one, above 1 for trials added later."""


FIRST = Occasion()
"""A campaign of one trial."""


def seen_x_m(x_m: T, start_x_m: float, scale_error: float) -> T:
    """Position of the body as measured by a camera with a scale error."""
    return x_m + scale_error * (x_m - start_x_m)


def batch_seed(seed: int, batch: str) -> int:
    """The random seed that the trials of one batch of a campaign share."""
    return zlib.crc32(f"{seed} {batch}".encode())


def trial_seed(seed: int, number: int) -> int:
    """The random seed of a lab's trial ``number`` if none is given: no two walks of a robot meet the same grains."""
    return zlib.crc32(f"{seed} trial {number}".encode())


def _normal(*seed: int) -> float:
    return float(np.random.default_rng(seed).standard_normal())
