"""Pure error: the scatter of replicates within a cell, independent of any model.

Trials of one cell differ by measurement noise and by the bed's φ missing its set point. Neither is the model's fault,
so fits are weighted and tested by it. Walking and swimming cells scatter differently and are pooled separately.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.data.distributions import chi2_ppf, f_sf

BATCHES_DIFFER = 1e-3
"""p-value below which batches count as different: their replicates differ by more than those of one batch."""
SINGULAR = 1e-9
"""Variance, in that of the best known combination of batch terms, below which one is not determined."""
EXCESS = 1e-3
"""p-value below which a cell scatters more than the others, and its own scatter is used: near the switch between
walking and swimming a set-point error flips single replicates, and such a cell is not precise."""
LEAST_DOF = 3
"""Degrees of freedom below which a regime's scatter is taken from both regimes together."""
FEW_REPLICATES = LEAST_FOR_TREND = 12
"""Degrees of freedom below which a usual lab's scatter is the prior, and from which scatter may depend on ω."""
HALF_SHRUNK = 20
"""Degrees of freedom at which an estimated correlation is shrunk by half."""
SLOPE_PRIOR = (0.0, 2.0)
"""Prior mean and standard deviation of the power of ω that a variance follows."""
REGIME_SLOPE_SD = 0.7
"""Prior standard deviation of a regime's power of ω about that of both regimes. The power is 0 for sensor noise, 2 for
set-point errors of φ; without the prior, a few cells at one end would give a trend by chance."""
PRIOR_DOF = 2.0
"""Degrees of freedom of a prior: of the scatter of both regimes for each of them, and of a usual lab's where all
replicates are few."""
FLOOR = 1e-7
"""Smallest credible standard deviation [m or m/s]: replicates that agree to the last bit prove nothing, and have no
degrees of freedom."""


@dataclass(frozen=True)
class PureError:
    """Covariance of one trial ``(cells, 4, 4)``, pooled sd ``(4,)`` and its degrees of freedom ``(4,)``."""

    covariance: Floats
    sd: Floats
    dof: Ints
    own: Bools
    """Cells ``(n,)`` whose own scatter is used."""


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
    ``usual (4,)`` the standard deviations of a usual lab, a prior in case the few replicates agree by chance.
    ``rounding (4,)`` are the standard deviations of rounding errors, below which no scatter is believed.
    """
    return pooled_error(_squares(residual, cell, count), np.maximum(count - 1, 0), walking, omega, usual, rounding)


def _squares(residual: Floats, cell: Ints, count: Ints) -> Floats:
    """Sums of squares and products of each cell ``(cells, 4, 4)``."""
    cells, observables = count.shape
    square = np.zeros((cells, observables, observables))
    filled = np.nan_to_num(residual)
    np.add.at(square, cell, filled[:, :, None] * filled[:, None, :])
    return square


def pooled_error(
    square: Floats, dof: Ints, walking: Bools, omega: Floats, usual: Floats, rounding: Floats | None = None
) -> PureError:
    """Pool the cells' sums of squares and products ``square (cells, m, m)`` of ``dof (cells, m)`` degrees of freedom
    each; the rest as in ``pure_error``, for any number m of observables.
    """
    least = _least(rounding, len(usual))
    variance, dof = np.diagonal(square, axis1=1, axis2=2), dof.copy()
    regimes = _regimes(walking)
    keep = _consistent(variance, dof, omega, regimes, least)
    overall = _pooled_variance(variance[keep], dof[keep])
    copies = overall <= FLOOR**2
    overall = np.where(copies, np.nan, np.maximum(overall, least**2))
    dof[:, copies] = 0
    kept = dof * keep[:, None]
    known = kept.sum(axis=0)
    # NaN stays where nothing is known.
    prior = np.where((known > 0) & (known < FEW_REPLICATES), usual**2, overall)
    together = (known * overall + PRIOR_DOF * prior) / (known + PRIOR_DOF)
    slope = _common_slope(variance, kept, omega, regimes)
    covariance = np.zeros_like(square)
    for regime in regimes:
        pooled = _power_law(variance[regime], kept[regime], omega[regime], slope, together, prior, least)
        covariance[regime] = _pool(square[regime], dof[regime], keep[regime], pooled)
    return PureError(covariance, np.sqrt(overall), known, ~keep)


def consistent_cells(
    residual: Floats, cell: Ints, count: Ints, walking: Bools, omega: Floats, rounding: Floats | None = None
) -> Bools:
    """Cells ``(n,)`` that scatter no more than the others of their regime; arguments as in ``pure_error``."""
    variance = np.diagonal(_squares(residual, cell, count), axis1=1, axis2=2)
    least = _least(rounding, count.shape[1])
    return _consistent(variance, np.maximum(count - 1, 0), omega, _regimes(walking), least)


def _least(rounding: Floats | None, observables: int) -> Floats:
    """The smallest credible standard deviation of each observable."""
    return np.full(observables, FLOOR) if rounding is None else np.maximum(rounding, FLOOR)


def _regimes(walking: Bools) -> list[Bools]:
    return [regime for regime in (walking, ~walking) if regime.any()]


def without_batch_effects(
    residual: Floats, cell: Ints, shape: Floats, batch: NDArray[np.str_], consistent: Bools
) -> Floats:
    """Residuals ``(trials, 4)`` about cell means without what each ``batch (trials,)`` adds in proportion to ``shape
    (cells, 4)``: 1 for an offset, the cell means for a scale. Observables whose batches do not differ are unchanged.

    This is estimated from ``consistent (cells,)`` cells: a softer bed makes trials near the switch swim, and a few such
    conditions would pass for a scale of the readings of all.
    """
    found, index = residual.copy(), np.unique(batch, return_inverse=True)[1]
    for column in range(residual.shape[1]):
        seen = np.isfinite(residual[:, column])
        some = residual[seen, column], cell[seen], index[seen]
        found[seen, column] = _about_batches(*some, shape[:, column], consistent)
    return found


def _about_batches(residual: Floats, cell: Ints, batch: Ints, shape: Floats, consistent: Bools) -> Floats:
    """Residuals of one observable without their batches' terms.

    Scaled so that their sum of squares per degree of freedom of the cells is the variance within batches.
    """
    some, batches = consistent[cell], int(batch.max(initial=0)) + 1
    terms, scale = _batch_terms(residual[some], cell[some], batch[some], shape, batches)
    if not terms.any():
        return residual
    counts = _counts(cell, batch, len(shape), batches)
    of_cell = counts @ terms / np.maximum(counts.sum(axis=1), 1.0)
    return np.asarray((residual - shape[cell] * (terms[batch] - of_cell[cell])) * scale)


def _counts(cell: Ints, batch: Ints, cells: int, batches: int) -> Floats:
    """Trials of each cell in each batch ``(cells, batches)``."""
    counts = np.zeros((cells, batches))
    np.add.at(counts, (cell, batch), 1.0)
    return counts


def _batch_terms(residual: Floats, cell: Ints, batch: Ints, shape: Floats, batches: int) -> tuple[Floats, float]:
    """Terms of the batches ``(batches,)`` by least squares, 0 unless an F-test says that they differ, and the factor by
    which degrees of freedom lost to them reduce the residuals."""
    none, counts = (np.zeros(batches), 1.0), _counts(cell, batch, len(shape), batches)
    in_cell, measured = np.maximum(counts.sum(axis=1), 1.0), counts.any(axis=1)
    shape, dof = np.where(measured, shape, 0.0), len(cell) - int(np.count_nonzero(measured))
    # Batches that share no cell with others add nothing to residuals about cell means.
    shared = counts[np.count_nonzero(counts, axis=1) > 1].any(axis=0)
    if not 1 < np.count_nonzero(shared) <= dof:
        return none
    weights = counts[:, shared] * shape[:, None]
    variance, axes = np.linalg.eigh(np.diag(weights.T @ shape) - weights.T @ (weights / in_cell[:, None]))
    told = variance > SINGULAR * variance.max()
    lost, axes = int(np.count_nonzero(told)), axes[:, told] / np.sqrt(variance[told])
    if not 0 < lost < dof:
        return none
    terms = np.zeros(batches)
    terms[shared] = axes @ (axes.T @ np.bincount(batch, shape[cell] * residual, batches)[shared])
    rest = residual - shape[cell] * (terms[batch] - (counts @ terms / in_cell)[cell])
    within = float(rest @ rest)
    differ = _differ(float(residual @ residual) - within, lost, within, dof - lost)
    return (terms, float(np.sqrt(dof / (dof - lost)))) if differ else none


def _differ(between: float, dof: int, within: float, dof_within: int) -> bool:
    """Whether a sum of squares between batches exceeds what scatter within them would give (F-test)."""
    ratio = between / dof / max(within / dof_within, FLOOR**2)
    return bool(f_sf(np.array(ratio), np.array(float(dof)), np.array(float(dof_within))) < BATCHES_DIFFER)


def within_batches(
    residual: Floats, cell: Ints, count: Ints, batch: NDArray[np.str_], some: Bools
) -> tuple[Floats, Ints]:
    """Residuals ``(trials, 4)`` about the mean of their cell and ``batch (trials,)``, and ``count (cells, 4)`` less the
    degrees of freedom this costs; unchanged in an observable whose batches do not differ.

    Unlike a zero or a scale, another k changes each cell differently; no difference between batches is in the scatter
    within them. Only ``some (cells,)`` are changed and compared: where one batch walks and another swims, their
    difference is a mixture's scatter.
    """
    found, left = residual.copy(), count.copy()
    group, index = np.unique(np.stack([cell, np.unique(batch, return_inverse=True)[1]]), axis=1, return_inverse=True)
    for column in range(residual.shape[1]):
        used = some[cell] & np.isfinite(residual[:, column])
        values, of_group = residual[used, column], index[used]
        trials = np.bincount(of_group, minlength=group.shape[1])
        mean = np.bincount(of_group, values, group.shape[1]) / np.maximum(trials, 1)
        batches = np.bincount(group[0], trials > 0, len(count)).astype(np.int64)
        between, within = np.maximum(batches - 1, 0), values - mean[of_group]
        squares, lost, dof = float(within @ within), int(between.sum()), len(values) - int(batches.sum())
        if lost and dof >= FEW_REPLICATES and _differ(float(values @ values) - squares, lost, squares, dof):
            found[used, column] = within
            left[:, column] -= between
    return found, left


def effective_dof(dof: Ints) -> Floats:
    """Degrees of freedom of a scatter ``(4,)``, including those of the prior where replicates are few."""
    return np.asarray(dof + np.where(dof < FEW_REPLICATES, PRIOR_DOF, 0.0))


def _consistent(sums: Floats, dof: Ints, omega: Floats, regimes: Sequence[Bools], least: Floats) -> Bools:
    """Cells ``(n,)`` that scatter no more than the others of their regime.

    Iterated from the median: with few cells, one that flips between the regimes would hide in the mean.
    """
    median, pooled, pooled_dof = np.empty((3, *sums.shape))
    for regime in regimes:
        median[regime] = pooled[regime] = _median_variance(sums[regime], dof[regime], least)
        pooled_dof[regime] = dof[regime].sum(axis=0) / 2
    keep = np.ones(len(sums), dtype=bool)
    for _ in range(10):
        known = (dof > 0) & (pooled_dof > 0)
        ratio = np.divide(sums, dof * pooled, out=np.zeros_like(sums), where=known)
        tail = np.where(known, f_sf(ratio, np.maximum(dof, 1), np.maximum(pooled_dof, 1)), 1.0)
        before, keep = keep, ~(tail < EXCESS / sums.shape[1]).any(axis=1)
        kept = dof * keep[:, None]
        slope = _common_slope(sums, kept, omega, regimes)
        for regime in regimes:
            prior = median[regime][0]
            pooled[regime] = _power_law(sums[regime], kept[regime], omega[regime], slope, prior, prior, least)
            pooled_dof[regime] = kept[regime].sum(axis=0) - kept[regime]
        if (before == keep).all():
            break
    return keep


def _median_variance(sums: Floats, dof: Ints, least: Floats) -> Floats:
    """Variance of one trial ``(4,)`` from the median of the cells' variances, NaN where there are no replicates."""
    found = np.full(sums.shape[1], np.nan)
    for column in range(sums.shape[1]):
        had = dof[:, column] > 0
        if had.any():
            own, n = sums[had, column] / dof[had, column], float(np.median(dof[had, column]))
            found[column] = max(float(np.median(own)) * n / chi2_ppf(0.5, n), least[column] ** 2)
    return found


def _pool(square: Floats, dof: Ints, keep: Bools, pooled: Floats) -> Floats:
    """Covariance of one trial in each cell of a regime, from the variances of one trial ``pooled (n, 4)``.

    For cells that are not kept, their own scatter is used, but never less than the pooled one.
    """
    scaled = square / np.sqrt(pooled[:, :, None] * pooled[:, None, :])
    correlation = _correlation(scaled[keep], dof[keep])
    sums = np.diagonal(square, axis1=1, axis2=2)
    own_variance = np.divide(sums, dof, out=np.zeros_like(sums), where=dof > 0)
    sd = np.sqrt(np.where(keep[:, None], pooled, np.maximum(own_variance, pooled)))
    return np.asarray(sd[:, :, None] * sd[:, None, :] * correlation)


def _pooled_variance(sums: Floats, dof: Ints) -> Floats:
    """Pooled variance ``(4,)``, NaN where there are no replicates."""
    total = dof.sum(axis=0)
    pooled = np.divide(sums.sum(axis=0), total, out=np.full(len(total), np.nan), where=total > 0)
    return np.asarray(np.maximum(pooled, FLOOR**2))


def _common_slope(sums: Floats, dof: Ints, omega: Floats, regimes: Sequence[Bools]) -> Floats:
    """Power of ω ``(4,)`` that the variance follows in both regimes, each at its own level."""
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
            start = np.array([*(np.log(max(_pooled_variance(sums[r], dof[r])[column], FLOOR**2)) for r in levels), 0.0])
            found[column] = _gamma_regression(sums[:, column], weight, design, start, *SLOPE_PRIOR)[-1]
    return found


def _power_law(
    sums: Floats, dof: Ints, omega: Floats, slope: Floats, together: Floats, prior: Floats, least: Floats
) -> Floats:
    """Variance of one trial ``(cells, 4)`` of a regime, a power law in ω fitted to the cells' scatter.

    A step takes π/ω and a body on faster legs shakes more, so scatter depends on ω. ``slope (4,)`` is the power of both
    regimes, ``together (4,)`` the variance of all cells of both, ``prior (4,)`` the prior of a regime's variance. With
    few replicates the power is that of both regimes, with fewer than ``LEAST_DOF`` the variance, too.
    """
    x = np.log(omega)
    found = np.empty_like(sums)
    for column in range(sums.shape[1]):
        total, weight = dof[:, column].sum(), dof[:, column].astype(float)
        if total < LEAST_DOF:
            found[:, column] = together[column]
            continue
        centred = x - np.average(x, weights=weight)
        mean = (sums[weight > 0, column].sum() + PRIOR_DOF * prior[column]) / (total + PRIOR_DOF)
        b = np.array([np.log(np.maximum(mean, FLOOR**2)), slope[column]])
        design = np.stack([np.ones_like(x), centred], axis=-1)
        if total >= LEAST_FOR_TREND:
            b = _gamma_regression(sums[:, column], weight, design, b, slope[column], REGIME_SLOPE_SD)
        found[:, column] = np.exp(design @ b)
    return np.maximum(found, least**2)


def _gamma_regression(sums: Floats, weight: Floats, design: Floats, start: Floats, slope: float, sd: float) -> Floats:
    """Coefficients of ln variance, the last of them a power of ω with the prior ``slope ± sd``.

    s² is a scaled χ² with few degrees of freedom, whose log-likelihood -dof/2 (η + s²/e^η), η = design · b, is that of
    a gamma regression; the posterior mode is found by Fisher scoring.
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
    """Pooled correlation ``(4, 4)``, shrunk towards zero where replicates are few."""
    pooled = square.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diagonal(pooled), 1e-12))
    correlation = pooled / scale[:, None] / scale[None, :]
    total = dof.sum(axis=0).max() if len(dof) else 0
    shrunk = correlation * total / (total + HALF_SHRUNK)
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)
