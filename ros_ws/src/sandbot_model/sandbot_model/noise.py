"""Pure error: what replicates of one cell scatter, and nothing else.

Trials of one cell differ by measurement noise and by the bed's φ missing its set point; neither is the model's fault,
so the fit and every test are measured against it. Walking and swimming scatter differently and are pooled apart.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

EXCESS = 1e-3
"""A cell whose scatter is less likely than this under the pooled one is taken at its own: near the switch between
walking and swimming a set-point error flips single replicates, and that must not pass as precision."""
FLOOR = 1e-7
"""Smallest standard deviation [m or m/s] taken seriously: replicates that agree to the last bit prove nothing."""


@dataclass(frozen=True)
class PureError:
    """Covariance of one trial ``(cells, 4, 4)``, pooled sd ``(4,)`` and its degrees of freedom ``(4,)``."""

    covariance: Floats
    sd: Floats
    dof: Ints
    own: Bools
    """Cells ``(n,)`` taken at their own scatter."""


def pure_error(residual: Floats, cell: Ints, count: Ints, walking: Bools) -> PureError:
    """Pool residuals ``(trials, 4)`` about their cell's mean; ``count (cells, 4)`` are the replicates measured."""
    cells, observables = count.shape
    square = np.zeros((cells, observables, observables))
    filled = np.nan_to_num(residual)
    np.add.at(square, cell, filled[:, :, None] * filled[:, None, :])
    dof = np.maximum(count - 1, 0)
    covariance = np.zeros_like(square)
    own = np.zeros(cells, dtype=bool)
    for regime in (walking, ~walking):
        if regime.any():
            covariance[regime], own[regime] = _pool(square[regime], dof[regime], square, dof)
    variance = np.diagonal(square, axis1=1, axis2=2)
    keep = ~own[:, None]
    total = (dof * keep).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        sd = np.where(total > 0, np.sqrt((variance * keep).sum(axis=0) / total), np.nan)
    return PureError(covariance, np.maximum(sd, FLOOR), total, own)


def _pool(square: Floats, dof: Ints, all_square: Floats, all_dof: Ints) -> tuple[Floats, Bools]:
    """Pooled covariance of a regime for each of its cells, and which cells stand on their own scatter."""
    keep = np.ones(len(square), dtype=bool)
    sums = np.diagonal(square, axis1=1, axis2=2)
    for _ in range(10):
        pooled = _variance(sums[keep], dof[keep], np.diagonal(all_square, axis1=1, axis2=2), all_dof)
        tail = np.where(dof > 0, chi2.sf(sums / pooled, np.maximum(dof, 1)), 1.0)
        now = ~(tail < EXCESS / sums.shape[1]).any(axis=1)
        if not now.any() or (now == keep).all():
            break
        keep = now
    correlation = _correlation(square[keep], dof[keep])
    # Where a cell scatters beyond the pool it is taken at its own, never at less.
    mine = np.divide(sums, dof, out=np.zeros_like(sums), where=dof > 0)
    spread = np.sqrt(np.where(keep[:, None], pooled, np.maximum(mine, pooled)))
    return spread[:, :, None] * spread[:, None, :] * correlation, ~keep


def _variance(sums: Floats, dof: Ints, all_sums: Floats, all_dof: Ints) -> Floats:
    """Pooled variance ``(4,)``; from all regimes where this one has no replicates; NaN where nobody has."""
    total, everything = dof.sum(axis=0), all_dof.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        here = sums.sum(axis=0) / total
        anywhere = all_sums.sum(axis=0) / everything
    return np.maximum(np.where(total >= 2, here, anywhere), FLOOR**2)


def _correlation(square: Floats, dof: Ints) -> Floats:
    """Pooled correlation ``(4, 4)``, drawn towards none where replicates are few."""
    pooled = square.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diagonal(pooled), FLOOR**2))
    correlation = pooled / scale[:, None] / scale[None, :]
    trust = dof.sum(axis=0).max() if len(dof) else 0
    shrunk = correlation * trust / (trust + 6)
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)
