"""To which step numbers were rounded, and what that does to means of replicates.

Of replicates that scatter by more than the step each is rounded its own way, and their mean is as exact as if none had
been. Where they scatter by less all are rounded alike, however many there are: the mean is off by up to half a step.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEAST = 6
"""Different numbers from which they tell a step."""
SPARSE = 20
"""Steps that most neighbours are nearer than: of numbers farther apart any two differ by many of some small step."""
HARMONICS = np.arange(1, 101)


def rounding_step(column: Floats) -> float:
    """The step of which all differences of a column are multiples; 0 where there is none. NaN is not measured."""
    steps = np.diff(np.unique(column[np.isfinite(column)]))
    if len(steps) < LEAST - 1:
        return 0.0
    step = float(steps.min())
    regular = np.allclose(steps / step, np.round(steps / step), atol=1e-6)
    return step if regular and (steps < SPARSE * step).mean() > 0.5 else 0.0


def rounding_sd(values: Floats) -> Floats:
    """Standard deviation ``(m,)`` of what rounding takes from single numbers ``(n, m)``, evenly spread over a step."""
    return np.asarray([rounding_step(column) / np.sqrt(12) for column in values.T])


def rounded_alike(rounding: Floats, variance: Floats, count: NDArray[np.int64]) -> Floats:
    """Variance ``(cells, m)`` that rounding by ``rounding (m,)`` adds to means of ``count`` replicates beyond its own
    share of their ``variance``, that of one.

    Rounding errors are a sawtooth of what was rounded. Of two replicates that scatter by s about any place of a step
    their correlation is 6/π² Σ exp(-4π² k² s²/step²)/k², from the sawtooth's Fourier series (Widrow & Kollár 2008,
    Quantization Noise).
    """
    own = np.square(rounding)
    before = np.maximum(np.nan_to_num(variance) - own, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(own > 0, before / own, np.inf)[..., None]
    alike = 6 / np.pi**2 * np.sum(np.exp(-(np.pi**2) / 3 * HARMONICS**2 * ratio) / HARMONICS**2, axis=-1)
    return np.asarray(own * alike * (1 - 1 / np.maximum(count, 1)))
