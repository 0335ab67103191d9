"""Standard errors of a fit's unknowns, and their propagation to predictions."""

from collections.abc import Callable

import numpy as np

from sandbot_model.physics.arrays import Array

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


def propagated(predict: Callable[[Array], Array], unknowns: Array, covariance: Array) -> Array:
    """Standard deviation of ``predict(unknowns (n,))`` for unknowns of this covariance ``(n, n)``: the root sum of
    squares of ``deviations``."""
    return np.asarray(np.sqrt(sum((change**2 for change in deviations(predict, unknowns, covariance)), np.zeros(()))))


def deviations(predict: Callable[[Array], Array], unknowns: Array, covariance: Array) -> list[Array]:
    """Change of the prediction for one standard deviation along each principal axis of the covariance.

    (y_i+ - y_i-)/2, from predictions to either side: unlike a derivative, it shows a switch within one standard
    deviation. Axes without variance are left out.
    """
    variance, axes = np.linalg.eigh(covariance)
    sides = [
        [predict(unknowns + sign * size * axis) for sign in (-1.0, 1.0)]
        for size, axis in zip(np.sqrt(np.maximum(variance, 0.0)), axes.T, strict=True)
        if size > 0.0
    ]
    return [np.asarray(0.5 * (high - low)) for low, high in sides]
