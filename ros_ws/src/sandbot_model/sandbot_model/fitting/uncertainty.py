"""Standard errors of a fit's unknowns, and their propagation to predictions."""

from collections.abc import Callable
from functools import cache

import numpy as np

from sandbot_common.arrays import Bools, Floats

DETERMINED = 1e-12
"""Least curvature of the deviance along an unknown for it to count as determined by the data."""
ACCURACY = 1e-3
"""Relative accuracy of a column of a Jacobian: differences, in which dk/dφ does not follow k (2e-4 where only the
product of k and a factor is known). Columns whose combination cancels to this can't be distinguished."""


def standard_errors(jacobian: Floats) -> tuple[Floats, Floats]:
    """Standard errors and covariance of all unknowns: NaN for those that the data do not determine, ∞ for those that
    they determine only together with others."""
    normal = jacobian.T @ jacobian
    covariance, only_together = _inverse(normal)
    stderr = np.where(only_together, np.inf, np.sqrt(np.diag(covariance)))
    return np.where(np.diag(normal) < DETERMINED, np.nan, stderr), covariance


def covariance_of(normal: Floats) -> Floats:
    """The inverse of a normal matrix ``(n, n)``; 0 for unknowns, or combinations of them, that are not determined."""
    return _inverse(normal)[0]


def _inverse(normal: Floats) -> tuple[Floats, Bools]:
    """The inverse as in ``covariance_of``, and the unknowns ``(n,)`` that change along a combination which the data do
    not determine."""
    own = np.diag(normal)
    # Makes an unknown's own curvature 1 whatever its unit.
    size = np.sqrt(np.where(own < DETERMINED, np.inf, own))
    curvature, axes = np.linalg.eigh(normal / np.outer(size, size))
    known = curvature > ACCURACY**2
    steps = axes[:, known] / np.sqrt(curvature[known]) / size[:, None]
    return steps @ steps.T, np.linalg.norm(axes[:, ~known], axis=1) > ACCURACY


def principal_steps(covariance: Floats) -> Floats:
    """Steps ``(m, n)`` of one standard deviation along the principal axes of a covariance ``(n, n)`` of unknowns; axes
    without variance are left out."""
    # What is held may not move even by a rounding error.
    free = np.diag(covariance) > 0.0
    variance, axes = np.linalg.eigh(covariance[np.ix_(free, free)])
    steps = np.zeros((len(variance), len(covariance)))
    steps[:, free] = np.sqrt(np.maximum(variance, 0.0))[:, None] * axes.T
    return steps[variance > 0.0]


def change(
    predict: Callable[[Floats], tuple[Floats, Bools | bool]],
    unknowns: Floats,
    step: Floats,
    near: tuple[float, float],
    far: tuple[float, float],
) -> Floats:
    """Change of the prediction for one step from ``unknowns (n,)``.

    ``predict`` returns values ``(..., m)`` and whether the robot walks ``(...)``. ``near`` are the parts of the step,
    back and ahead, from which the change is extrapolated. Where the robot walks at only one of the parts ``far``, it is
    half the change between them: unlike a derivative, it shows a switch.
    """

    @cache
    def at(part: float) -> tuple[Floats, Bools | bool]:
        return predict(unknowns + part * step)

    smooth = (at(near[1])[0] - at(-near[0])[0]) / max(sum(near), np.finfo(float).tiny)
    (low, swims), (high, walks) = at(-far[0]), at(far[1])
    return np.where(np.asarray(swims != walks)[..., None], 0.5 * (high - low), smooth)
