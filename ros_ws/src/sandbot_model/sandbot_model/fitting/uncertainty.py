"""How precisely a fit knows its unknowns, and what it predicts."""

from collections.abc import Callable

import numpy as np

from sandbot_model.physics.arrays import Array

DETERMINED = 1e-12
"""Least curvature of the deviance along an unknown that the data determine."""


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
    """Standard deviation of ``predict(unknowns (n,))`` for unknowns of this covariance ``(n, n)``.

    The root of the squares of ``deviations`` summed.
    """
    return np.asarray(np.sqrt(sum((one**2 for one in deviations(predict, unknowns, covariance)), np.zeros(()))))


def deviations(predict: Callable[[Array], Array], unknowns: Array, covariance: Array) -> list[Array]:
    """What one standard deviation along each principal axis of the covariance changes in the prediction.

    (y_i+ - y_i-)/2, predicted to either side: beside a switch, where a derivative would show nothing, this shows the
    switch. Axes without any variance are left out.
    """
    variance, axes = np.linalg.eigh(covariance)
    sides = [
        [predict(unknowns + sign * size * axis) for sign in (-1.0, 1.0)]
        for size, axis in zip(np.sqrt(np.maximum(variance, 0.0)), axes.T, strict=True)
        if size > 0.0
    ]
    return [np.asarray(0.5 * (high - low)) for low, high in sides]
