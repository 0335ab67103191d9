"""How precisely a fit knows its unknowns, and what it predicts."""

from collections.abc import Callable

import numpy as np

from sandbot_model.physics.arrays import Array


def standard_errors(jacobian: Array) -> tuple[Array, Array]:
    """Standard errors and covariance of all unknowns; NaN and 0 for those that the data do not determine."""
    normal = jacobian.T @ jacobian
    covariance = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    undetermined = np.diag(normal) < 1e-12
    stderr[undetermined] = np.nan
    covariance[undetermined] = covariance[:, undetermined] = 0.0
    return np.asarray(stderr), np.asarray(covariance)


def propagated(predict: Callable[[Array], Array], unknowns: Array, covariance: Array) -> Array:
    """Standard deviation of ``predict(unknowns (n,))`` for unknowns of this covariance ``(n, n)``.

    Along each principal axis of the covariance the prediction is made one standard deviation to either side,
    √Σ_i ((y_i+ - y_i-)/2)²: beside a switch, where a derivative would show nothing, this shows the switch.
    """
    variance, axes = np.linalg.eigh(covariance)
    total = np.zeros(())
    for size, axis in zip(np.sqrt(np.maximum(variance, 0.0)), axes.T, strict=True):
        if size > 0.0:
            sides = [predict(unknowns + sign * size * axis) for sign in (-1.0, 1.0)]
            total = total + (0.5 * (sides[1] - sides[0])) ** 2
    return np.asarray(np.sqrt(total))
