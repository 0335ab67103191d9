"""The step to which numbers were rounded, and its effect on means of replicates.

Rounding errors of replicates that scatter by more than the step are independent and average out. Replicates that
scatter by less are all rounded alike: however many there are, their mean is off by up to half a step.
"""

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats

LEAST_VALUES = 6
"""Distinct values needed to recognise a step."""
SPARSE = 20
"""Steps within which most neighbouring values must lie: any values farther apart are multiples of some small step."""
HARMONICS = np.arange(1, 101)


def rounding_step(column: Floats) -> float:
    """The step of which all differences of a column are multiples; 0 where there is none. NaN is ignored."""
    steps = np.diff(np.unique(column[np.isfinite(column)]))
    if len(steps) < LEAST_VALUES - 1:
        return 0.0
    step = float(steps.min())
    regular = np.allclose(steps / step, np.round(steps / step), atol=1e-6)
    return step if regular and (steps < SPARSE * step).mean() > 0.5 else 0.0


def rounding_sd(values: Floats) -> Floats:
    """Standard deviation ``(m,)`` of the rounding errors of single numbers ``(n, m)``, uniform over a step."""
    return np.asarray([rounding_step(column) / np.sqrt(12) for column in values.T])


def shared_rounding_variance(rounding: Floats, variance: Floats, count: NDArray[np.int64]) -> Floats:
    """Variance ``(cells, m)`` that the correlation of rounding errors, of sd ``rounding (m,)``, adds to means of
    ``count`` replicates, each of ``variance`` (which includes its own rounding error).

    A rounding error is a sawtooth function of the number. For two replicates that scatter by s about an arbitrary place
    within a step, the errors' correlation is 6/π² Σ exp(-4π² k² s²/step²)/k², from the sawtooth's Fourier series
    (Widrow & Kollár 2008, Quantization Noise).
    """
    own = np.square(rounding)
    before = np.maximum(np.nan_to_num(variance) - own, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(own > 0, before / own, np.inf)[..., None]
    correlation = 6 / np.pi**2 * np.sum(np.exp(-(np.pi**2) / 3 * HARMONICS**2 * ratio) / HARMONICS**2, axis=-1)
    return np.asarray(own * correlation * (1 - 1 / np.maximum(count, 1)))
