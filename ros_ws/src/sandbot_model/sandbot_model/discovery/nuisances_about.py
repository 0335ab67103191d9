"""Nuisances of a fit, with their priors, and REML estimates of how far batches differ, linearised about the fit.

``nuisances_for`` builds them for given batch SDs; ``estimated_batch_sd`` finds these SDs; ``averaged_over_scatter``
gives standard errors averaged over the posterior of σ_b, ``averaged_with`` over several models. Of trials run in order
of ω or φ, replicates in other batches tell a drift of k from a dependence on ω or φ.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.batch_sd import ALIKE, BATCH, BATCH_SCALE, BATCH_ZERO, BatchSd, batch_sd_of, priors
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.structure import batch_share
from sandbot_model.discovery.verdict import leaves_nothing, sound
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit, refitted
from sandbot_model.fitting.goodness import Estimate
from sandbot_model.fitting.jacobian import slope_by_ln_k, without_nuisances
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import (
    Nuisances,
    averaged_estimate,
    averaged_moments,
    gains_for_errors,
    probability,
    scatter_of_batches,
    sizes_tried,
)
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.variants import NEW

ALONG = [Observable.speed, Observable.peak_speed, Observable.first_step]
"""Observables measured along the track."""
DRIFT, LIFT_ZERO, SPEED_SCALE = "drift", "lift_zero_m", "speed_scale"
"""Names of the drift of k along the run order, the zero of the lift and the scale along the track."""
LIFT_SCALE = "lift_scale"
"""That of the scale of the lift, no nuisance of every fit (see ``calibration_error``)."""
IN_ORDER = 0.9
"""Correlation of run order with φ or ω above which trials were run in order of it."""

APART = 0.1
"""Part of a campaign that lies between a condition's trials in other batches if these tell how k drifted."""


def run_in_order_of(cells: Cells) -> str:
    """``ω`` or ``φ`` if trials were run in order of it; empty if they were not, or no order is known."""
    if cells.order is None or not np.ptp(cells.order) > 0:
        return ""
    for axis, values in (("ω", cells.omega), ("φ", cells.level_phi[cells.level])):
        if np.ptp(values) > 0 and abs(np.corrcoef(values, cells.order)[0, 1]) > IN_ORDER:
            return axis
    return ""


def nuisances_for(fit: Fit, criteria: Criteria, batch_sd: BatchSd = ALIKE, drift: Estimate | None = None) -> Nuisances:
    """Nuisances and their priors for a refit; ``batch_sd`` are the standard deviations between batches.

    Start values are the fit's estimates. Priors of zero and scale come from ``accuracy`` in cameras.yaml, that of a
    drift is the usual one unless given.
    """
    trend = drift or Estimate(0.0, criteria.drift)
    slope, share, order = slope_by_ln_k(fit.problem, fit.state), batch_share(fit), fit.cells.order
    none, (lift, along) = np.zeros(len(fit.cells)), _slopes_of_readings(fit)
    found: list[tuple[str, float, Floats, Floats]] = []
    for name, of_one, moves_k in ((BATCH, slope, True), (BATCH_ZERO, lift, False), (BATCH_SCALE, along, False)):
        if sd := batch_sd[name]:
            found += [(name, sd, of_one * batch[:, None], batch if moves_k else none) for batch in share.T]
    if order is not None:
        found.append((DRIFT, trend.stderr, slope * order[:, None], order))
    if "lift" in fit.cells.observables:
        found.append((LIFT_ZERO, fit.cells.accuracy.lift_zero_m, lift, none))
    found.append((SPEED_SCALE, fit.cells.accuracy.speed_scale, along, none))
    names, sds, slopes, by_ln_k = zip(*found, strict=True)
    about, stderr = _current_estimates(fit, names)
    own = np.sqrt(share**2 @ np.minimum(batch_sd.ln_k, stderr[: share.shape[1]]) ** 2) if batch_sd.ln_k else none
    mean = np.where(np.array(names) == DRIFT, trend.value, 0.0)
    return Nuisances(names, np.array(sds), np.stack(slopes, axis=-1), own, about, np.stack(by_ln_k, axis=-1), mean)


def _slopes_of_readings(fit: Fit) -> Floats:
    """d(cell mean)/d(lift zero) and d(cell mean)/d(scale along the track) ``(2, cells, 4)``."""
    lift, along = slopes = np.zeros((2, *fit.predicted.shape))
    lift[:, Observable.lift] = 1.0
    along[:, ALONG] = fit.predicted[:, ALONG]
    return slopes


def _current_estimates(fit: Fit, names: Sequence[str]) -> tuple[Floats, Floats]:
    """A fit's estimates of nuisances and their standard errors ``(m,)``; 0 and ∞ for those it does not have."""
    known: dict[str, list[Estimate]] = {}
    for name, estimate in zip(fit.nuisances.names if fit.nuisances else (), fit.shared, strict=True):
        known.setdefault(name, []).append(estimate)
    own = [known[name].pop(0) if known.get(name) else Estimate(0.0, np.inf) for name in names]
    values, stderr = np.array(own).T
    return values, stderr


def estimated_batch_sd(fit: Fit, criteria: Criteria) -> BatchSd:
    """Estimated batch SDs about a fit, beside all other nuisances; 0 where the gain is below ``criteria.shared``."""
    return _batch_sd_and_gain(fit, criteria, criteria.shared)[0]


def gain_of_batches(fit: Fit, criteria: Criteria) -> float:
    """Decrease in -2 ln of the posterior if batches may differ, beside all other nuisances."""
    return _batch_sd_and_gain(fit, criteria, 0.0)[1]


def _batch_sd_and_gain(fit: Fit, criteria: Criteria, least: float) -> tuple[BatchSd, float]:
    """Batch SDs, added one at a time in order of gain, each given those before it, and their total gain."""
    prior, linear, found, total = priors(fit, criteria), _linearised(fit, criteria), ALIKE, 0.0

    def most_likely_sd(name: str) -> tuple[float, float]:
        """The most likely standard deviation of this nuisance between batches, and its gain, given those found."""
        return scatter_of_batches(*linear.of(name, found), sizes_tried(prior[name]), prior[name])

    remaining = set(prior.names)
    while remaining:
        tried = {name: most_likely_sd(name) for name in remaining}
        best = max(remaining, key=lambda name: (tried[name][1], name))
        sd, gain = tried[best]
        if gain <= least:
            break
        found, total = found.with_sd(best, sd), total + gain
        remaining.remove(best)
    if len(found.names) > 1:
        for name in found.names:
            found = found.with_sd(name, most_likely_sd(name)[0])
    return found, total


def averaged_over_scatter(fit: Fit, criteria: Criteria) -> Fit:
    """The same fit with standard errors averaged over the posterior of σ_b, whatever the verdict assumes of it.

    A best estimate of σ_b = 0 does not mean that the bed is exact, and standard errors for σ_b = 0 would be too small.
    Replicates of a condition in several batches constrain σ_b best. A verdict uses a half-normal prior; errors must
    also hold on an unusually rough bed, so here the prior is half-Cauchy.

    Where these replicates tell how k drifted, it is fitted again with that, unless this would change the verdict.
    """
    averaged = _averaged(fit, criteria, None)
    drift = _drift_of_replicates(fit, criteria) if sound(averaged) else None
    if drift is None:
        return averaged
    again = refitted(fit, nuisances_for(fit, criteria, batch_sd_of(fit), drift))
    again = _averaged(again, criteria, drift)
    return again if leaves_nothing(again, criteria) and sound(again) else averaged


def _averaged(fit: Fit, criteria: Criteria, drift: Estimate | None) -> Fit:
    """The fit with averaged errors; ``drift`` is what replicates tell of it."""
    given, sizes, gain = _scatter_posterior(fit, criteria, *_replicates(fit, criteria, drifts=drift is not None))
    moments = averaged_moments(*given, sizes, gain)
    stderr = np.where(np.isfinite(fit.stderr), np.sqrt(np.diag(moments)), fit.stderr)
    averaged = replace(fit, stderr=stderr, covariance=moments)
    batch_sd = batch_sd_of(fit).with_sd(BATCH, float(np.sqrt(probability(gain) @ sizes**2)))
    return with_sampled_errors(averaged, Problem(fit.model, fit.cells, nuisances_for(fit, criteria, batch_sd, drift)))


def _drift_of_replicates(fit: Fit, criteria: Criteria) -> Estimate | None:
    """The drift of k from the differences between batches within cells, and the prior; None if a drift does no harm, as
    with trials in random order, or if these differences do not show it."""
    order = fit.cells.batch_order
    if order is None or not run_in_order_of(fit.cells):
        return None
    if (np.nanmax(order, axis=1) - np.nanmin(order, axis=1)).max() < APART:
        return None
    replicates = _replicates(fit, criteria, drifts=True)
    _, sizes, gain = _scatter_posterior(fit, criteria, *replicates)
    value, stderr = averaged_estimate(*replicates, sizes, gain)
    return Estimate(criteria.drift * value, criteria.drift * stderr)


def averaged_with(fit: Fit, others: Sequence[Fit]) -> Fit:
    """The same fit with the rms errors about it of all models, each with its BIC weight: any of them may be true.

    What another model lacks, and the number of a convention, which means another thing there, keep their own errors.
    """
    if not others:
        return fit
    bic = np.array([one.bic for one in (fit, *others)])
    weights = np.exp(-0.5 * (bic - bic.min()))
    about = np.array([fit.covariance, *(_moments_about(fit, other) for other in others)])
    moments = np.average(about, axis=0, weights=weights)
    stderr = np.where(np.isfinite(fit.stderr), np.sqrt(np.diag(moments)), fit.stderr)
    return replace(fit, stderr=stderr, covariance=moments, sample=None)


def _moments_about(fit: Fit, other: Fit) -> Floats:
    """Second moments of another model's unknowns about a fit's, for the unknowns of the fit."""
    ours, names, levels = fit.model.names, list(other.model.names), np.arange(len(fit.point.ln_k))
    both = [at for at, name in enumerate(ours) if name in names and fit.model.parameter(name).doc != NEW]
    here = np.array([*both, *len(ours) + levels], dtype=np.int64)
    there = np.array([*(names.index(ours[at]) for at in both), *len(names) + levels], dtype=np.int64)
    values = [np.concatenate([one.point.theta, one.point.ln_k])[at] for one, at in ((other, there), (fit, here))]
    away = np.where(np.isfinite(fit.stderr[here] + other.stderr[there]), values[0] - values[1], 0.0)
    alone = np.setdiff1d(np.arange(len(fit.stderr)), here)
    moments = np.zeros_like(fit.covariance)
    moments[np.ix_(alone, alone)] = fit.covariance[np.ix_(alone, alone)]
    moments[np.ix_(here, here)] = other.covariance[np.ix_(there, there)] + np.outer(away, away)
    return moments


def _replicates(fit: Fit, criteria: Criteria, *, drifts: bool) -> tuple[Floats, Floats, Floats]:
    """Contrasts between batches within cells, and their slopes by each batch's ln k and by drift and readings.

    ``drifts``: whether contrasts may be due to a drift, as well as to the batches' beds; to these alone otherwise.
    """
    contrasts, between = within_cell_contrasts(fit)
    return contrasts, between, _drift_and_readings(fit, criteria) if drifts else np.zeros((len(contrasts), 1))


def _scatter_posterior(
    fit: Fit, criteria: Criteria, contrasts: Floats, between: Floats, within: Floats
) -> tuple[tuple[Floats, Floats, Floats, Floats], Floats, Floats]:
    """The linearised fit, extended by such contrasts; the grid of σ_b, and the gain of each."""
    residual, unknowns, batches, others = _linearised(fit, criteria).of(BATCH, batch_sd_of(fit))
    drift, readings = np.split(within, [1], axis=1)
    # The drift is the first of the others, too.
    others = np.block(
        [
            [others, np.zeros((len(residual), readings.shape[1]))],
            [drift, np.zeros((len(contrasts), others.shape[1] - 1)), readings],
        ]
    )
    residual, batches = np.concatenate([residual, contrasts]), np.concatenate([batches, between])
    given = residual, np.pad(unknowns, ((0, len(contrasts)), (0, 0))), batches, others
    return given, *gains_for_errors(*given, criteria.bed_scatter)


def within_cell_contrasts(fit: Fit) -> tuple[Floats, Floats]:
    """Whitened contrasts between batches within cells ``(m,)``, and their slopes by each batch's ln k ``(m, b)``.

    They do not depend on the model's prediction of the cell mean.
    """
    count, batch_mean = batch_share(fit).shape[1], fit.cells.batch_mean
    if batch_mean is None:
        return np.zeros(0), np.zeros((0, count))
    by_ln_k = slope_by_ln_k(fit.problem, fit.state)
    return _contrasts(fit, batch_mean[..., None])[:, 0], _contrasts(fit, _of_each_batch(by_ln_k, count))


def _drift_and_readings(fit: Fit, criteria: Criteria) -> Floats:
    """Slopes of the same contrasts ``(m, 1 + n)`` by a drift of k and by each batch's lift zero and speed scale, all in
    units of their priors."""
    order, sd = fit.cells.batch_order, priors(fit, criteria)
    assert order is not None
    drift = criteria.drift * slope_by_ln_k(fit.problem, fit.state)[:, None] * order[..., None]
    readings = zip((BATCH_ZERO, BATCH_SCALE), _slopes_of_readings(fit), strict=True)
    own = [_of_each_batch(sd[name] * slope, order.shape[1]) for name, slope in readings]
    return _contrasts(fit, np.concatenate([drift[..., None], *own], axis=-1))


def _of_each_batch(slope: Floats, count: int) -> Floats:
    """Slopes of the batches' means ``(cells, batches, 4, batches)`` by what each has of its own, ``slope (cells, 4)``
    of one trial."""
    return slope[:, None, :, None] * np.eye(count)[:, None]


def _contrasts(fit: Fit, values: Floats) -> Floats:
    """Whitened contrasts between batches within cells ``(m, q)`` of ``values (cells, batches, 4, q)``.

    Cells near a switch are left out: a slope there, steep for a tiny change of k only, would make all batches alike.
    """
    share, batch_mean, found = batch_share(fit), fit.cells.batch_mean, [np.zeros((0, values.shape[-1]))]
    assert batch_mean is not None
    clear = fit.problem.away_from_switch(fit.problem.widening(fit.state.covariance[0]))
    for cell in np.flatnonzero(clear & ((share > 0).sum(axis=1) > 1)):
        there = share[cell] > 0
        root = np.sqrt(share[cell, there])
        free = np.linalg.svd(root[None])[2][1:] * root
        known = np.isfinite(batch_mean[cell, there]).all(axis=0) & fit.problem.measured[cell]
        whiten = fit.problem.whiten[cell] * known
        each = np.where(known[:, None], values[cell, there], 0.0)
        found.append(np.einsum("fb,oj,bjq->foq", free, whiten, each, optimize=True).reshape(-1, values.shape[-1]))
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class _Linearised:
    """Whitened residuals with nuisances at 0, and their slopes by the fitted parameters, by each batch's nuisances (by
    name), and by the other nuisances in units of their priors."""

    residual: Floats
    unknowns: Floats
    batches: dict[str, Floats]
    others: Floats

    def of(self, name: str, beside: BatchSd) -> tuple[Floats, Floats, Floats, Floats]:
        """The four arrays if batches differ in ``name``; their other differences count among the other nuisances."""
        other = [beside[key] * slopes for key, slopes in self.batches.items() if key != name and beside[key]]
        return self.residual, self.unknowns, self.batches[name], np.column_stack([self.others, *other])


def _linearised(fit: Fit, criteria: Criteria) -> _Linearised:
    possible = priors(fit, criteria).names
    own = nuisances_for(fit, criteria, BatchSd(**dict.fromkeys(possible, 1.0)))
    residual, unknowns, _ = without_nuisances(fit.problem, fit.state)
    unit = np.zeros((len(residual), len(own.sd)))
    shift = fit.problem.whitened(fit.state.whiten, own.slope)[0]
    unit[: shift[..., 0].size] = shift.reshape(-1, len(own.sd)) * own.sd
    names = np.array(own.names)
    batches = {name: unit[:, names == name] for name in possible}
    return _Linearised(residual, unknowns, batches, unit[:, ~np.isin(names, possible)])
