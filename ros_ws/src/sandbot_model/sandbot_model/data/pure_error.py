"""Pure error: what replicates of one cell scatter, and nothing else.

Trials of one cell differ by measurement noise and by the bed's φ missing its set point; neither is the model's fault,
so the fit and every test are measured against it. Walking and swimming scatter differently and are pooled apart.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbot_model.data.distributions import chi2_ppf, f_sf

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

EXCESS = 1e-3
"""A cell whose scatter is less likely than this under the others' is taken at its own: near the switch between
walking and swimming a set-point error flips single replicates, and that must not pass as precision."""
LEAST_DOF = 3
"""Degrees of freedom below which a regime's scatter is taken from both regimes together."""
FEW_REPLICATES = LEAST_FOR_TREND = 12
"""Degrees of freedom below which a usual lab counts beside them, and from which scatter may have a trend with ω."""
FEW = 20
"""Degrees of freedom at which an estimated correlation is shrunk by half."""
PRIOR = 2.0
"""Degrees of freedom with which the scatter of both regimes together counts in each, and that of a usual lab where all
replicates are few."""
FLOOR = 1e-7
"""Smallest standard deviation [m or m/s] taken seriously: replicates that agree to the last bit prove nothing, and
have no degrees of freedom."""


@dataclass(frozen=True)
class PureError:
    """Covariance of one trial ``(cells, 4, 4)``, pooled sd ``(4,)`` and its degrees of freedom ``(4,)``."""

    covariance: Floats
    sd: Floats
    dof: Ints
    own: Bools
    """Cells ``(n,)`` taken at their own scatter."""


def pure_error(residual: Floats, cell: Ints, count: Ints, walking: Bools, omega: Floats, usual: Floats) -> PureError:
    """Pool residuals ``(trials, 4)`` about their cell's mean.

    ``count (cells, 4)`` are the replicates measured, ``walking (cells,)`` the regime, ``omega (cells,)`` [rad/s] and
    ``usual (4,)`` the standard deviations of a usual lab: one pair of replicates that happen to agree knows less.
    """
    cells, observables = count.shape
    square = np.zeros((cells, observables, observables))
    filled = np.nan_to_num(residual)
    np.add.at(square, cell, filled[:, :, None] * filled[:, None, :])
    variance, dof = np.diagonal(square, axis1=1, axis2=2), np.maximum(count - 1, 0)
    keep = np.ones(cells, dtype=bool)
    for regime in (walking, ~walking):
        keep[regime] = _consistent(variance[regime], dof[regime], omega[regime])
    overall = _constant(variance[keep], dof[keep])
    copies = overall <= FLOOR**2
    overall[copies], dof[:, copies] = np.nan, 0
    known = (dof * keep[:, None]).sum(axis=0)
    # NaN stays where nothing is known.
    prior = np.where((known > 0) & (known < FEW_REPLICATES), usual**2, overall)
    covariance = np.zeros_like(square)
    for regime in (walking, ~walking):
        if regime.any():
            together = (known * overall + PRIOR * prior) / (known + PRIOR)
            covariance[regime] = _pool(square[regime], dof[regime], omega[regime], keep[regime], together, prior)
    return PureError(covariance, np.sqrt(overall), known, ~keep)


def freedom_known(dof: Ints) -> Floats:
    """Degrees of freedom ``(4,)`` on which a scatter is known that is taken from few replicates and a usual lab."""
    return np.asarray(dof + np.where(dof < FEW_REPLICATES, PRIOR, 0.0))


def _consistent(sums: Floats, dof: Ints, omega: Floats) -> Bools:
    """Cells ``(n,)`` of a regime that scatter no more than the others.

    It begins at the median: one cell of a few that flips would pass in the mean, as scatter of all.
    """
    keep = np.ones(len(sums), dtype=bool)
    usual = _median(sums, dof)
    pooled, freedom = np.broadcast_to(usual, sums.shape), dof.sum(axis=0) / 2 + np.zeros(sums.shape)
    for _ in range(10):
        known = (dof > 0) & (freedom > 0)
        ratio = np.divide(sums, dof * pooled, out=np.zeros_like(sums), where=known)
        tail = np.where(known, f_sf(ratio, np.maximum(dof, 1), np.maximum(freedom, 1)), 1.0)
        before, keep = keep, ~(tail < EXCESS / sums.shape[1]).any(axis=1)
        pooled = _trend(sums, dof * keep[:, None], omega, usual, usual)
        freedom = (dof * keep[:, None]).sum(axis=0) - dof * keep[:, None]
        if (before == keep).all():
            break
    return keep


def _median(sums: Floats, dof: Ints) -> Floats:
    """Variance of one trial ``(4,)`` by the median of the cells', NaN where there are no replicates."""
    found = np.full(sums.shape[1], np.nan)
    for column in range(sums.shape[1]):
        had = dof[:, column] > 0
        if had.any():
            own, n = sums[had, column] / dof[had, column], float(np.median(dof[had, column]))
            found[column] = max(float(np.median(own)) * n / chi2_ppf(0.5, n), FLOOR**2)
    return found


def _pool(square: Floats, dof: Ints, omega: Floats, keep: Bools, together: Floats, prior: Floats) -> Floats:
    """Covariance of one trial in each cell of a regime, those that are not kept at their own scatter.

    ``together (4,)`` is the variance of all cells of both regimes, ``prior (4,)`` what counts beside a regime's own.
    """
    sums = np.diagonal(square, axis1=1, axis2=2)
    pooled = _trend(sums, dof * keep[:, None], omega, together, prior)
    scaled = square / np.sqrt(pooled[:, :, None] * pooled[:, None, :])
    correlation = _correlation(scaled[keep], dof[keep])
    # Where a cell scatters beyond the pool it is taken at its own, never at less.
    own_variance = np.divide(sums, dof, out=np.zeros_like(sums), where=dof > 0)
    sd = np.sqrt(np.where(keep[:, None], pooled, np.maximum(own_variance, pooled)))
    return np.asarray(sd[:, :, None] * sd[:, None, :] * correlation)


def _constant(sums: Floats, dof: Ints) -> Floats:
    """Pooled variance ``(4,)``, NaN where there are no replicates."""
    total = dof.sum(axis=0)
    pooled = np.divide(sums.sum(axis=0), total, out=np.full(len(total), np.nan), where=total > 0)
    return np.asarray(np.maximum(pooled, FLOOR**2))


def _trend(sums: Floats, dof: Ints, omega: Floats, together: Floats, prior: Floats) -> Floats:
    """Variance of one trial ``(cells, 4)``, a power law in ω fitted by maximum likelihood to the cells' scatter.

    A step takes π/ω and a body on faster legs shakes more, so scatter follows ω; s² is a scaled χ² with few degrees of
    freedom, whose likelihood -dof/2 (η + s²/e^η), η = a + b ln ω, is that of a gamma regression. With few replicates
    it is constant, with hardly any that of both regimes together.
    """
    x = np.log(omega)
    found = np.empty_like(sums)
    for column in range(sums.shape[1]):
        total, weight = dof[:, column].sum(), dof[:, column].astype(float)
        if total < LEAST_DOF:
            found[:, column] = together[column]
            continue
        centre = np.average(x, weights=weight)
        # A handful of replicates is not trusted by itself.
        mean = (sums[weight > 0, column].sum() + PRIOR * prior[column]) / (total + PRIOR)
        mean = np.maximum(mean, FLOOR**2)
        level, slope = np.log(mean), 0.0
        shape = np.average((x - centre) ** 2, weights=weight)
        if total >= LEAST_FOR_TREND and shape > 1e-3:
            level, slope = _gamma(sums[:, column], weight, x - centre, level)
        found[:, column] = np.exp(level + slope * (x - centre))
    return np.maximum(found, FLOOR**2)


def _gamma(sums: Floats, weight: Floats, x: Floats, level: float) -> tuple[float, float]:
    """Level and slope of ln variance, by Fisher scoring; the slope is held to ±4 (variance ∝ ω⁴ at most)."""
    b = np.array([level, 0.0])
    design = np.stack([np.ones_like(x), x], axis=-1)
    information = design.T @ (weight[:, None] * design)
    ratio = np.divide(sums, weight, out=np.zeros_like(sums), where=weight > 0)
    for _ in range(50):
        eta = np.clip(design @ b, level - 12, level + 12)
        step = np.linalg.solve(information, design.T @ (weight * (ratio * np.exp(-eta) - 1)))
        b += np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < 1e-6:
            break
    return float(b[0]), float(np.clip(b[1], -4.0, 4.0))


def _correlation(square: Floats, dof: Ints) -> Floats:
    """Pooled correlation ``(4, 4)``, drawn towards none where replicates are few."""
    pooled = square.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diagonal(pooled), 1e-12))
    correlation = pooled / scale[:, None] / scale[None, :]
    total = dof.sum(axis=0).max() if len(dof) else 0
    shrunk = correlation * total / (total + FEW)
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)
