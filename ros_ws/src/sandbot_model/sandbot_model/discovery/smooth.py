"""A smooth discrepancy over φ and ω, as the alternative to an effect or to random batch offsets.

To the fit, linearised, is added δ ~ GP(0, a² exp(-½ (Δφ/ℓ_φ)² - ½ (Δ ln ω/ℓ_ω)²)), a model discrepancy without any
physics (Kennedy & O'Hagan 2001, J. R. Stat. Soc. B 63, 425). Its gain is the largest fall of -2 ln restricted
likelihood on a grid of a, ℓ_φ and ℓ_ω.

* A claim from one observable alone must gain more in BIC than such a discrepancy (``alone``).
* Offsets of ln k that are smooth over φ and ω are not random differences between batches: the model is wrong.
"""

from itertools import product

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.nuisances import free_of, gains
from sandbot_model.physics.observables import Observable

LENGTHS = (0.15, 0.3, 0.6, 1.2, 2.4)
"""ℓ tried, in units of what the data span."""
SIZES = np.geomspace(0.1, 300.0, 50)
"""a tried, in typical standard errors."""


def smooth_gain(base: Fit, observable: Observable) -> float:
    """Fall of -2 ln restricted likelihood if a smooth discrepancy in one observable is added to a fit."""
    jacobian, residual = full_jacobian(base.problem, base.state)[0], base.state.all_residuals[0]
    slope = np.zeros((len(residual), len(base.cells)))
    weight = np.where(base.problem.measured[:, observable], base.state.whiten[0][:, observable, observable], 0.0)
    cell = np.arange(len(base.cells))
    slope[len(Observable) * cell + observable, cell] = weight
    contrasts = free_of(jacobian, np.zeros((len(residual), 0)))
    at = np.stack([base.cells.phi, np.log(base.cells.omega)], axis=1)
    return float(best_gain(contrasts @ residual, contrasts @ slope, kernels(at)))


def best_gain(missed: Floats, slope: Floats, tried: list[Floats]) -> Floats:
    """Fall of -2 ln likelihood of contrasts ``missed (..., c)`` with the best of the ``tried`` kernels of δ ``(n,)``;
    ``slope (c, n)`` are the derivatives of the contrasts by δ."""
    scale = np.sqrt(np.sum(slope**2, axis=0))
    sizes = SIZES / max(float(np.median(scale[scale > 0])), 1e-300) if (scale > 0).any() else SIZES
    return np.asarray(np.max([_gain(missed, slope, kernel, sizes) for kernel in tried], axis=0))


def kernels(at: Floats) -> list[Floats]:
    """Correlation of δ between places ``at (n, 2)`` for every pair of lengths."""
    distance = [np.subtract.outer(x, x) / max(np.ptp(x), 1e-12) for x in at.T]
    return [np.exp(-0.5 * ((distance[0] / a) ** 2 + (distance[1] / b) ** 2)) for a, b in product(LENGTHS, LENGTHS)]


def _gain(missed: Floats, slope: Floats, kernel: Floats, sizes: Floats) -> Floats:
    """The gain of one kernel at its best size a."""
    variances, axes = np.linalg.eigh(slope @ kernel @ slope.T)
    return np.asarray(gains(missed @ axes, np.maximum(variances, 0.0), sizes).max(axis=-1))
