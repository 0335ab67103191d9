"""What trials share, linear about a fit: the nuisances with their priors, and how far the bed scatters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sandbot_model.discovery.batch_sd import ALIKE, BATCH, BATCH_SCALE, BATCH_ZERO, BatchSd, batch_sd_of, priors
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.structure import batch_share
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import Estimate
from sandbot_model.fitting.jacobian import slope_by_ln_k, without_nuisances
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import (
    Nuisances,
    averaged_moments,
    gains_for_errors,
    probability,
    scatter_of_batches,
    sizes_tried,
)
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.observables import Observable

ALONG = [Observable.speed, Observable.peak_speed, Observable.first_step]
DRIFT, LIFT_ZERO, SPEED_SCALE = "drift", "lift_zero_m", "speed_scale"
"""Names of the drift of k along the run order, the zero of the lift and the scale along the track."""


def nuisances_for(fit: Fit, criteria: Criteria, batch_sd: BatchSd = ALIKE) -> Nuisances:
    """Nuisances about a fit; ``apart`` is how far batches differ.

    They begin at what the fit has found of them. How well readings are known is said beside the cameras.
    """
    slope, share, order = slope_by_ln_k(fit.problem, fit.state), batch_share(fit), fit.cells.order
    none, (lift, along) = np.zeros(len(fit.cells)), np.zeros((2, *slope.shape))
    lift[:, Observable.lift] = 1.0
    along[:, ALONG] = fit.predicted[:, ALONG]
    found: list[tuple[str, float, Array, Array]] = []
    for name, of_one, moves_k in ((BATCH, slope, True), (BATCH_ZERO, lift, False), (BATCH_SCALE, along, False)):
        if sd := batch_sd[name]:
            found += [(name, sd, of_one * batch[:, None], batch if moves_k else none) for batch in share.T]
    if order is not None:
        found.append((DRIFT, criteria.drift, slope * order[:, None], order))
    if "lift" in fit.cells.observables:
        found.append((LIFT_ZERO, fit.cells.accuracy.lift_zero_m, lift, none))
    found.append((SPEED_SCALE, fit.cells.accuracy.speed_scale, along, none))
    names, sds, slopes, by_ln_k = zip(*found, strict=True)
    about, stderr = _current_estimates(fit, names)
    own = np.sqrt(share**2 @ np.minimum(batch_sd.ln_k, stderr[: share.shape[1]]) ** 2) if batch_sd.ln_k else none
    return Nuisances(names, np.array(sds), np.stack(slopes, axis=-1), own, about, np.stack(by_ln_k, axis=-1))


def _current_estimates(fit: Fit, names: Sequence[str]) -> tuple[Array, Array]:
    """What a fit has found of nuisances, and its errors ``(m,)``; 0 and ∞ of what it knows nothing of."""
    known: dict[str, list[Estimate]] = {}
    for name, estimate in zip(fit.nuisances.names if fit.nuisances else (), fit.shared, strict=True):
        known.setdefault(name, []).append(estimate)
    own = [known[name].pop(0) if known.get(name) else Estimate(0.0, np.inf) for name in names]
    values, stderr = np.array(own).T
    return values, stderr


def estimated_batch_sd(fit: Fit, criteria: Criteria) -> BatchSd:
    """How far batches differ about a fit, beside all other nuisances; in nothing where they need not."""
    return _batch_sd_and_gain(fit, criteria, criteria.shared)[0]


def gain_of_batches(fit: Fit, criteria: Criteria) -> float:
    """What batches that differ would gain over a fit beside all other nuisances, in -2 ln of the posterior."""
    return _batch_sd_and_gain(fit, criteria, 0.0)[1]


def _batch_sd_and_gain(fit: Fit, criteria: Criteria, least: float) -> tuple[BatchSd, float]:
    """How far batches differ, what gains most first and each beside those before it, and what they gain together."""
    prior, linear, found, total = priors(fit, criteria), _linearised(fit, criteria), ALIKE, 0.0

    def differ_in(name: str) -> tuple[float, float]:
        """The standard deviation of what batches have of this name, and what it gains, beside what was found."""
        return scatter_of_batches(*linear.of(name, found), sizes_tried(prior[name]), prior[name])

    left = set(prior.names)
    while left:
        tried = {name: differ_in(name) for name in left}
        best = max(left, key=lambda name: (tried[name][1], name))
        sd, gain = tried[best]
        if gain <= least:
            break
        found, total = found.with_sd(best, sd), total + gain
        left.remove(best)
    if len(found.names) > 1:
        for name in found.names:
            found = found.with_sd(name, differ_in(name)[0])
    return found, total


def averaged_over_scatter(fit: Fit, criteria: Criteria) -> Fit:
    """The same fit with errors that average over how far the bed may scatter, not only as far as a verdict grants.

    What the data do not show of σ_b, its prior says: a fit that takes the bed for exact where nothing shows that it is
    not has errors that are too small. Replicates of a condition in several batches show it best. A verdict takes no bed
    for rougher than beds are; errors must hold on one that is, so their prior has a Cauchy's tail.
    """
    given, sizes, gain = _scatter_posterior(fit, criteria)
    moments = averaged_moments(*given, sizes, gain)
    stderr = np.where(np.isnan(fit.stderr), np.nan, np.sqrt(np.diag(moments)))
    averaged = replace(fit, stderr=stderr, covariance=moments)
    scatter = float(np.sqrt(probability(gain) @ sizes**2))
    beside = Problem(fit.model, fit.cells, nuisances_for(fit, criteria, batch_sd_of(fit).with_sd(BATCH, scatter)))
    return with_sampled_errors(averaged, beside)


def _scatter_posterior(fit: Fit, criteria: Criteria) -> tuple[tuple[Array, Array, Array, Array], Array, Array]:
    """What is linear about a fit, with how batches differ within cells, the σ_b tried and what each gains by it."""
    residual, unknowns, batches, others = _linearised(fit, criteria).of(BATCH, batch_sd_of(fit))
    contrasts, between = _within_cell_contrasts(fit)
    residual, batches = np.concatenate([residual, contrasts]), np.concatenate([batches, between])
    unknowns, others = (np.pad(slopes, ((0, len(contrasts)), (0, 0))) for slopes in (unknowns, others))
    given = residual, unknowns, batches, others
    return given, *gains_for_errors(*given, criteria.bed_scatter)


def _within_cell_contrasts(fit: Fit) -> tuple[Array, Array]:
    """How batches differ within cells: whitened contrasts ``(m,)``, and their slopes by each batch's ln k ``(m, b)``.

    They are free of what any model says of a cell's mean.
    """
    share, batch_mean, by_ln_k = batch_share(fit), fit.cells.batch_mean, slope_by_ln_k(fit.problem, fit.state)
    contrasts, slopes = [np.zeros(0)], [np.zeros((0, share.shape[1]))]
    if batch_mean is None:
        return contrasts[0], slopes[0]
    for cell in np.flatnonzero((share > 0).sum(axis=1) > 1):
        there = share[cell] > 0
        root = np.sqrt(share[cell, there])
        free, whiten = np.linalg.svd(root[None])[2][1:] * root, fit.problem.whiten[cell]
        known = np.isfinite(batch_mean[cell, there]).all(axis=0) & fit.problem.measured[cell]
        contrasts.append((free @ np.where(known, batch_mean[cell, there], 0.0) @ whiten.T).ravel())
        slope = np.zeros((len(free), 4, share.shape[1]))
        slope[:, :, there] = np.einsum("ij,j,bc->bic", whiten, np.where(known, by_ln_k[cell], 0.0), free)
        slopes.append(slope.reshape(-1, share.shape[1]))
    return np.concatenate(contrasts), np.concatenate(slopes)


@dataclass(frozen=True, eq=False)
class _Linearised:
    """Whitened residuals without any nuisance, and their slopes by what was fitted, by what each batch has of each
    name, and by the other nuisances in units of their priors."""

    residual: Array
    unknowns: Array
    batches: dict[str, Array]
    others: Array

    def of(self, name: str, beside: BatchSd) -> tuple[Array, Array, Array, Array]:
        """The same with batches that differ in one thing, what else they do among the other nuisances."""
        else_ = [beside[one] * slopes for one, slopes in self.batches.items() if one != name and beside[one]]
        return self.residual, self.unknowns, self.batches[name], np.column_stack([*else_, self.others])


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
