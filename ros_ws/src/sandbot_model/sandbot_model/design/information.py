"""Expected information of a measurement about which of several explanations holds.

I(M; y) is the mutual information of the explanation M and the outcome y. If each explanation predicts a Gaussian, it
has no closed form, but a lower bound that is exact in both limits (Kolchinsky & Tracey 2017, Entropy 19, 361):

    I ≥ -Σ_i w_i ln Σ_j w_j exp(-B_ij)

with the Bhattacharyya distance B_ij of two predictions: 0 where all predict the same, the entropy of w where none
overlap. For two with one covariance Σ, B = Δᵀ Σ⁻¹ Δ / 8: with the noise alone in Σ it ranks measurements as Hunter &
Reiner (1965) do, with the parameters' uncertainty as well as the leading term of Buzzi-Ferraris & Forzatti (1983).
"""

import numpy as np

from sandbot_common.arrays import Floats


def information(weights: Floats, means: Floats, covariances: Floats) -> Floats:
    """Bound on I [nat] ``(...)`` for explanations of ``weights (m,)``, ``means (..., m, n)``, ``covariances
    (..., m, n, n)``."""
    distance = bhattacharyya(
        means[..., :, None, :], means[..., None, :, :], covariances[..., :, None, :, :], covariances[..., None, :, :, :]
    )
    return np.asarray(-np.log(np.exp(-distance) @ weights) @ weights)


def bhattacharyya(mean: Floats, other: Floats, covariance: Floats, other_covariance: Floats) -> Floats:
    """Distance ``(...)`` of Gaussians: ⅛ Δᵀ S⁻¹ Δ + ½ ln(|S| / √(|Σ₁||Σ₂|)), S = (Σ₁ + Σ₂)/2."""
    average, gap = 0.5 * (covariance + other_covariance), mean - other
    mahalanobis = np.sum(gap * np.linalg.solve(average, gap[..., None])[..., 0], axis=-1)
    widening = _ln_det(average) - 0.5 * (_ln_det(covariance) + _ln_det(other_covariance))
    return np.asarray(mahalanobis / 8 + 0.5 * widening)


def _ln_det(matrix: Floats) -> Floats:
    return np.asarray(np.linalg.slogdet(matrix)[1])
