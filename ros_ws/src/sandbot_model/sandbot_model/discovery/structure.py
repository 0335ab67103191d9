"""Tests whether batch offsets are random, as those of a bed are, or structured, as those of a wrong model are.

A missing effect that is absorbed by offsets of the bed, condition by condition, leaves offsets of ln k that have a
trend over φ, ω or run order, differ between gaits, or are smooth over φ and ω. So do zeros and scales of batches.
"""

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.discovery.batch_sd import batch_sd_of, priors
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.smooth import best_gain, kernels
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import without_nuisances
from sandbot_model.fitting.nuisances import (
    LEAST_SHARE,
    free_of,
    gains_of_scatter,
    probability,
    sizes_tried,
    trend_p,
)

STRUCTURE = 0.005
"""p-value of either test below which offsets count as structured."""
LinearModel = tuple[Floats, Floats, Floats, Floats]
"""See ``_linear_model``."""
DRAWS = 1000
"""Draws of random offsets: few batches look smooth by chance more often than many do."""


def at_random(fit: Fit, criteria: Criteria) -> bool:
    """Whether the batches' offsets look random: neither a trend nor smooth over φ and ω."""
    if fit.nuisances is None:
        return True
    # NaN: blocks that each cover all of φ and ω, in an unknown order, can have no trend.
    found = [p(fit, criteria, name) for name in batch_sd_of(fit).names for p in (trend_p_of, smooth_p)]
    return not found or bool(np.nanmin(found) >= STRUCTURE)


def trend_p_of(fit: Fit, criteria: Criteria, name: str) -> float:
    """p-value of a test for a trend of the batches' offsets ``name`` over φ, ω (to second order), run order and gait.

    Averaged over the posterior of their standard deviation; NaN where no such trend is possible.
    """
    residual, unknowns, batches, others = model = _linear_model(fit, name)
    trends, found = batches @ _trends(fit), 0.0
    for size, share in zip(*_scatter(model, priors(fit, criteria)[name]), strict=True):
        if share > LEAST_SHARE:
            every = np.column_stack([size * batches, others])
            found += share * trend_p(residual, unknowns, np.eye(len(residual)) + every @ every.T, trends)
    return found


def smooth_p(fit: Fit, criteria: Criteria, name: str) -> float:
    """p-value of a test for offsets smoother over φ and ω than random ones, drawn with σ_b from its posterior."""
    residual, unknowns, batches, others = model = _linear_model(fit, name)
    contrasts, (sizes, share) = free_of(unknowns, others), _scatter(model, priors(fit, criteria)[name])
    axes, scale, turned = np.linalg.svd(contrasts @ batches, full_matrices=False)
    slope, rng = scale[:, None] * turned, np.random.default_rng(0)
    count, every = slope.shape
    offsets = rng.choice(sizes, (DRAWS, 1), p=share) * rng.standard_normal((DRAWS, every))
    drawn = offsets @ slope.T + rng.standard_normal((DRAWS, count))
    missed = np.concatenate([(axes.T @ (contrasts @ residual))[None], drawn])
    gain = best_gain(missed, slope, kernels(_positions(fit)[:, :2])) - best_gain(missed, slope, [np.eye(every)])
    return float(np.mean(gain >= gain[0]))


def _scatter(model: LinearModel, prior: float) -> tuple[Floats, Floats]:
    """Standard deviations of the offsets that are tried, and the posterior probability of each."""
    sizes = sizes_tried(prior)
    return sizes, probability(gains_of_scatter(*model, sizes, prior))


def _linear_model(fit: Fit, name: str) -> LinearModel:
    """Whitened residuals with all nuisances at zero, and their derivatives by the fitted unknowns, by the batches'
    offsets ``name``, and by the other nuisances in units of their priors."""
    residual, unknowns, shift = without_nuisances(fit.problem, fit.state)
    assert fit.nuisances is not None
    sd, batches = fit.nuisances.sd, np.array([other == name for other in fit.nuisances.names])
    return residual, unknowns, shift[:, batches], shift[:, ~batches] * sd[~batches]


def _positions(fit: Fit) -> Floats:
    """φ, ω and, where it is known, run order of each batch ``(batches, 2 or 3)``, standardised over cells."""
    cells = fit.cells
    at = np.stack([cells.phi, cells.omega, *([] if cells.order is None else [cells.order])], axis=1)
    return _batch_means(fit, (at - at.mean(axis=0)) / np.maximum(at.std(axis=0), 1e-12))


def _trends(fit: Fit) -> Floats:
    """Regressors of a trend over φ, ω, run order and gait ``(batches, t)``."""
    at, gaits = _positions(fit), _gaits(fit)
    phi, omega = at[:, 0], at[:, 1]
    trends = np.stack([*at.T, phi**2, omega**2, phi * omega, *gaits.T, *(omega * gaits.T)], axis=1)
    return np.asarray(trends - trends.mean(axis=0))


def _gaits(fit: Fit) -> Floats:
    """Fraction of each batch's trials in each gait but the first ``(batches, gaits - 1)``."""
    names = np.array(fit.cells.gait)
    return _batch_means(fit, (names[:, None] == np.unique(names)[1:]).astype(float))


def _batch_means(fit: Fit, of_cells: Floats) -> Floats:
    """Means over the trials of each batch ``(batches, n)`` of values of the cells ``(cells, n)``."""
    share = batch_share(fit)
    return np.asarray((share / share.sum(axis=0)).T @ of_cells)


def batch_share(fit: Fit) -> Floats:
    """Fraction of each cell's trials in each batch ``(cells, batches)``; every cell is a batch if none are given."""
    given = fit.cells.batch_share
    return np.eye(len(fit.cells)) if given is None else given
