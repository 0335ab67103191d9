"""Something smooth over φ and ω in place of an effect, or of a bed that scatters.

On top of a fit, linear about it, stands δ ~ GP(0, a² exp(-½ (Δφ/ℓ_φ)² - ½ (Δ ln ω/ℓ_ω)²)), what somebody would add who
knows no physics (Kennedy & O'Hagan 2001, J. R. Stat. Soc. B 63, 425). It gains in -2 ln restricted likelihood, over a
grid of a, ℓ_φ and ℓ_ω.

* A claim from one observable alone must gain more in BIC than such a discrepancy (``alone``).
* Offsets of ln k that are smooth over φ and ω are no batches that differ at random, but a model that is wrong.
"""

from itertools import product

import numpy as np

from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.nuisances import free_of, gains
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.observables import Observable

LENGTHS = (0.15, 0.3, 0.6, 1.2, 2.4)
"""ℓ tried, in units of what the data span."""
SIZES = np.geomspace(0.1, 300.0, 50)
"""a tried, in typical standard errors."""


def smooth_gain(base: Fit, observable: Observable) -> float:
    """Fall of -2 ln restricted likelihood where a smooth discrepancy of one observable is granted to a fit."""
    jacobian, residual = full_jacobian(base.problem, base.state)[0], base.state.all_residuals[0]
    slope = np.zeros((len(residual), len(base.cells)))
    weight = np.where(base.problem.measured[:, observable], base.state.whiten[0][:, observable, observable], 0.0)
    each = np.arange(len(base.cells))
    slope[len(Observable) * each + observable, each] = weight
    contrasts = free_of(jacobian, np.zeros((len(residual), 0)))
    at = np.stack([base.cells.phi, np.log(base.cells.omega)], axis=1)
    return float(gain_of_any(contrasts @ residual, contrasts @ slope, kernels(at)))


def gain_of_any(missed: Array, slope: Array, some: list[Array]) -> Array:
    """Fall of -2 ln likelihood of contrasts ``missed (..., c)`` by the best kernel of δ ``(n,)``, ``slope (c, n)``
    theirs by δ."""
    scale = np.sqrt(np.sum(slope**2, axis=0))
    sizes = SIZES / max(float(np.median(scale[scale > 0])), 1e-300) if (scale > 0).any() else SIZES
    return np.asarray(np.max([_gain(missed, slope, kernel, sizes) for kernel in some], axis=0))


def kernels(at: Array) -> list[Array]:
    """Correlation of δ between places ``at (n, 2)`` for every pair of lengths."""
    away = [np.subtract.outer(x, x) / max(np.ptp(x), 1e-12) for x in at.T]
    return [np.exp(-0.5 * ((away[0] / a) ** 2 + (away[1] / b) ** 2)) for a, b in product(LENGTHS, LENGTHS)]


def _gain(missed: Array, slope: Array, kernel: Array, sizes: Array) -> Array:
    """Of the best size."""
    shares, axes = np.linalg.eigh(slope @ kernel @ slope.T)
    return np.asarray(gains(missed @ axes, np.maximum(shares, 0.0), sizes).max(axis=-1))
