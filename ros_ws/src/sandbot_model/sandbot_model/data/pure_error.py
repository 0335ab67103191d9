"""Pure error: what replicates of one cell scatter, and nothing else.

Trials of one cell differ by measurement noise and by the bed's φ missing its set point; neither is the model's fault,
so the fit and every test are measured against it. Walking and swimming scatter differently and are pooled apart.
"""

from collections.abc import Sequence
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
USUAL_SLOPE = (0.0, 2.0)
"""Power of ω with which a variance goes before anything is measured, and how far it may be off."""
OWN_SLOPE = 0.7
"""How far a regime's power of ω may be off that of both: it is 0 where sensors scatter, 2 where φ misses its set
point, and a few cells at one end would tell of their own luck."""
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


def pure_error(
    residual: Floats,
    cell: Ints,
    count: Ints,
    walking: Bools,
    omega: Floats,
    usual: Floats,
    rounding: Floats | None = None,
) -> PureError:
    """Pool residuals ``(trials, 4)`` about their cell's mean.

    ``count (cells, 4)`` are the replicates measured, ``walking (cells,)`` the regime, ``omega (cells,)`` [rad/s] and
    ``usual (4,)`` the standard deviations of a usual lab: one pair of replicates that happen to agree knows less.
    ``rounding (4,)`` are the standard deviations of what rounding takes: replicates that agree are no nearer than that.
    """
    least = np.full(residual.shape[1], FLOOR) if rounding is None else np.maximum(rounding, FLOOR)
    cells, observables = count.shape
    square = np.zeros((cells, observables, observables))
    filled = np.nan_to_num(residual)
    np.add.at(square, cell, filled[:, :, None] * filled[:, None, :])
    variance, dof = np.diagonal(square, axis1=1, axis2=2), np.maximum(count - 1, 0)
    regimes = [regime for regime in (walking, ~walking) if regime.any()]
    keep = _consistent(variance, dof, omega, regimes, least)
    overall = _constant(variance[keep], dof[keep])
    copies = overall <= FLOOR**2
    overall = np.where(copies, np.nan, np.maximum(overall, least**2))
    dof[:, copies] = 0
    kept = dof * keep[:, None]
    known = kept.sum(axis=0)
    # NaN stays where nothing is known.
    prior = np.where((known > 0) & (known < FEW_REPLICATES), usual**2, overall)
    together = (known * overall + PRIOR * prior) / (known + PRIOR)
    slope = _common_slope(variance, kept, omega, regimes)
    covariance = np.zeros_like(square)
    for regime in regimes:
        pooled = _trend(variance[regime], kept[regime], omega[regime], slope, together, prior, least)
        covariance[regime] = _pool(square[regime], dof[regime], keep[regime], pooled)
    return PureError(covariance, np.sqrt(overall), known, ~keep)


def freedom_known(dof: Ints) -> Floats:
    """Degrees of freedom ``(4,)`` on which a scatter is known that is taken from few replicates and a usual lab."""
    return np.asarray(dof + np.where(dof < FEW_REPLICATES, PRIOR, 0.0))


def _consistent(sums: Floats, dof: Ints, omega: Floats, regimes: Sequence[Bools], least: Floats) -> Bools:
    """Cells ``(n,)`` that scatter no more than the others of their regime.

    It begins at the median: one cell of a few that flips would pass in the mean, as scatter of all.
    """
    usual, pooled, freedom = np.empty((3, *sums.shape))
    for regime in regimes:
        usual[regime] = pooled[regime] = _median(sums[regime], dof[regime], least)
        freedom[regime] = dof[regime].sum(axis=0) / 2
    keep = np.ones(len(sums), dtype=bool)
    for _ in range(10):
        known = (dof > 0) & (freedom > 0)
        ratio = np.divide(sums, dof * pooled, out=np.zeros_like(sums), where=known)
        tail = np.where(known, f_sf(ratio, np.maximum(dof, 1), np.maximum(freedom, 1)), 1.0)
        before, keep = keep, ~(tail < EXCESS / sums.shape[1]).any(axis=1)
        kept = dof * keep[:, None]
        slope = _common_slope(sums, kept, omega, regimes)
        for regime in regimes:
            by_median = usual[regime][0]
            pooled[regime] = _trend(sums[regime], kept[regime], omega[regime], slope, by_median, by_median, least)
            freedom[regime] = kept[regime].sum(axis=0) - kept[regime]
        if (before == keep).all():
            break
    return keep


def _median(sums: Floats, dof: Ints, least: Floats) -> Floats:
    """Variance of one trial ``(4,)`` by the median of the cells', NaN where there are no replicates."""
    found = np.full(sums.shape[1], np.nan)
    for column in range(sums.shape[1]):
        had = dof[:, column] > 0
        if had.any():
            own, n = sums[had, column] / dof[had, column], float(np.median(dof[had, column]))
            found[column] = max(float(np.median(own)) * n / chi2_ppf(0.5, n), least[column] ** 2)
    return found


def _pool(square: Floats, dof: Ints, keep: Bools, pooled: Floats) -> Floats:
    """Covariance of one trial in each cell of a regime that scatters by ``pooled (n, 4)``, variances of one trial.

    Cells that are not kept are taken at their own scatter.
    """
    scaled = square / np.sqrt(pooled[:, :, None] * pooled[:, None, :])
    correlation = _correlation(scaled[keep], dof[keep])
    # Where a cell scatters beyond the pool it is taken at its own, never at less.
    sums = np.diagonal(square, axis1=1, axis2=2)
    own_variance = np.divide(sums, dof, out=np.zeros_like(sums), where=dof > 0)
    sd = np.sqrt(np.where(keep[:, None], pooled, np.maximum(own_variance, pooled)))
    return np.asarray(sd[:, :, None] * sd[:, None, :] * correlation)


def _constant(sums: Floats, dof: Ints) -> Floats:
    """Pooled variance ``(4,)``, NaN where there are no replicates."""
    total = dof.sum(axis=0)
    pooled = np.divide(sums.sum(axis=0), total, out=np.full(len(total), np.nan), where=total > 0)
    return np.asarray(np.maximum(pooled, FLOOR**2))


def _common_slope(sums: Floats, dof: Ints, omega: Floats, regimes: Sequence[Bools]) -> Floats:
    """Power of ω ``(4,)`` with which the variance goes in both regimes, each at its own level."""
    x = np.log(omega)
    found = np.zeros(sums.shape[1])
    for column in range(sums.shape[1]):
        weight = dof[:, column].astype(float)
        levels = [regime for regime in regimes if weight[regime].any()]
        if weight.sum() >= LEAST_FOR_TREND:
            centred = np.zeros(len(x))
            for regime in levels:
                centred[regime] = x[regime] - np.average(x[regime], weights=weight[regime])
            design = np.stack([*levels, centred], axis=-1).astype(float)
            start = [np.log(max(_constant(sums[r], dof[r])[column], FLOOR**2)) for r in levels]
            found[column] = _gamma(sums[:, column], weight, design, np.array([*start, 0.0]), *USUAL_SLOPE)[-1]
    return found


def _trend(
    sums: Floats, dof: Ints, omega: Floats, slope: Floats, together: Floats, prior: Floats, least: Floats
) -> Floats:
    """Variance of one trial ``(cells, 4)`` of a regime, a power law in ω fitted to the cells' scatter.

    A step takes π/ω and a body on faster legs shakes more, so scatter follows ω. ``slope (4,)`` is the power of both
    regimes, ``together (4,)`` the variance of all cells of both, ``prior (4,)`` what counts beside a regime's own. With
    few replicates the power is that of both regimes, with hardly any the variance too.
    """
    x = np.log(omega)
    found = np.empty_like(sums)
    for column in range(sums.shape[1]):
        total, weight = dof[:, column].sum(), dof[:, column].astype(float)
        if total < LEAST_DOF:
            found[:, column] = together[column]
            continue
        centred = x - np.average(x, weights=weight)
        # A handful of replicates is not trusted by itself.
        mean = (sums[weight > 0, column].sum() + PRIOR * prior[column]) / (total + PRIOR)
        b = np.array([np.log(np.maximum(mean, FLOOR**2)), slope[column]])
        design = np.stack([np.ones_like(x), centred], axis=-1)
        if total >= LEAST_FOR_TREND:
            b = _gamma(sums[:, column], weight, design, b, slope[column], OWN_SLOPE)
        found[:, column] = np.exp(design @ b)
    return np.maximum(found, least**2)


def _gamma(sums: Floats, weight: Floats, design: Floats, start: Floats, slope: float, sd: float) -> Floats:
    """Coefficients of ln variance, the last of them a power of ω that is ``slope ± sd`` beforehand.

    s² is a scaled χ² with few degrees of freedom, whose likelihood -dof/2 (η + s²/e^η), η = design · b, is that of a
    gamma regression; its largest value with the prior is found by Fisher scoring.
    """
    b, precision = start.copy(), 2 / sd**2
    information = design.T @ (weight[:, None] * design)
    information[-1, -1] += precision
    ratio = np.divide(sums, weight, out=np.zeros_like(sums), where=weight > 0)
    level = design @ start
    for _ in range(50):
        eta = np.clip(design @ b, level - 12, level + 12)
        gradient = design.T @ (weight * (ratio * np.exp(-eta) - 1))
        gradient[-1] += precision * (slope - b[-1])
        step = np.linalg.solve(information, gradient)
        b += np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < 1e-6:
            break
    return b


def _correlation(square: Floats, dof: Ints) -> Floats:
    """Pooled correlation ``(4, 4)``, drawn towards none where replicates are few."""
    pooled = square.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diagonal(pooled), 1e-12))
    correlation = pooled / scale[:, None] / scale[None, :]
    total = dof.sum(axis=0).max() if len(dof) else 0
    shrunk = correlation * total / (total + FEW)
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)
