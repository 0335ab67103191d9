"""Standard errors of a fit's unknowns, and their propagation to predictions."""

from collections.abc import Callable
from functools import cache

import numpy as np

from sandbot_model.physics.arrays import Array, Bool

DETERMINED = 1e-12
"""Least curvature of the deviance along an unknown for it to count as determined by the data."""


def standard_errors(jacobian: Array) -> tuple[Array, Array]:
    """Standard errors and covariance of all unknowns; NaN and 0 for those that the data do not determine."""
    normal = jacobian.T @ jacobian
    covariance = covariance_of(normal)
    return np.where(np.diag(normal) < DETERMINED, np.nan, np.sqrt(np.maximum(np.diag(covariance), 0.0))), covariance


def covariance_of(normal: Array) -> Array:
    """The inverse of normal equations; 0 for unknowns that the data do not determine."""
    covariance = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    undetermined = np.diag(normal) < DETERMINED
    covariance[undetermined] = covariance[:, undetermined] = 0.0
    return np.asarray(covariance)


def principal_steps(covariance: Array) -> Array:
    """Steps ``(m, n)`` of one standard deviation along the principal axes of a covariance ``(n, n)`` of unknowns; axes
    without variance are left out."""
    # What is held may not move even by a rounding error.
    free = np.diag(covariance) > 0.0
    variance, axes = np.linalg.eigh(covariance[np.ix_(free, free)])
    steps = np.zeros((len(variance), len(covariance)))
    steps[:, free] = np.sqrt(np.maximum(variance, 0.0))[:, None] * axes.T
    return steps[variance > 0.0]


def change(
    predict: Callable[[Array], tuple[Array, Bool | bool]],
    unknowns: Array,
    step: Array,
    near: tuple[float, float],
    far: tuple[float, float],
) -> Array:
    """Change of the prediction for one step from ``unknowns (n,)``.

    ``predict`` returns values ``(..., m)`` and whether the robot walks ``(...)``. ``near`` are the parts of the step,
    back and ahead, from which the change is extrapolated. Where the robot walks at only one of the parts ``far``, it is
    half the change between them: unlike a derivative, it shows a switch.
    """

    @cache
    def at(part: float) -> tuple[Array, Bool | bool]:
        return predict(unknowns + part * step)

    smooth = (at(near[1])[0] - at(-near[0])[0]) / max(sum(near), np.finfo(float).tiny)
    (low, swims), (high, walks) = at(-far[0]), at(far[1])
    return np.where(np.asarray(swims != walks)[..., None], 0.5 * (high - low), smooth)
