"""Whether the offsets of batches are random: a bed that scatters follows nothing, a model that is wrong does.

A missing effect that is granted to the bed, condition by condition, leaves offsets of ln k with a trend over φ, ω or
the order, or from gait to gait, or smooth over φ and ω at some length.
"""

import numpy as np

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.smooth import gain_of_any, kernels
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
from sandbot_model.physics.arrays import Array, Bool

BATCH = "ln_k"
"""Name of every batch's offset."""
STRUCTURE = 0.005
"""p-value of either test below which offsets follow something, and are no nuisance."""
Offsets = tuple[Array, Array, Array, Array]
"""See ``_offsets``."""
DRAWS = 1000
"""Beds drawn that scatter at random: few batches look smooth more often than many."""


def at_random(fit: Fit, criteria: Criteria) -> bool:
    """Whether the batches' offsets follow nothing: neither a trend nor anything smooth."""
    if fit.nuisances is None or BATCH not in fit.nuisances.names:
        return True
    # Blocks that each hold all of φ and ω, in no order that is told, have no trend.
    return bool(np.nanmin([trend_p_of(fit, criteria), smooth_p(fit, criteria)]) >= STRUCTURE)


def trend_p_of(fit: Fit, criteria: Criteria) -> float:
    """p-value of no trend of the batches' offsets over φ, ω (to second order), run order and gait, averaged over σ_b.

    NaN where there is no such trend.
    """
    residual, unknowns, batches, others = seen = _offsets(fit)
    trends, found = batches @ _trends(fit), 0.0
    for size, share in zip(*_scatter(seen, criteria), strict=True):
        if share > LEAST_SHARE:
            every = np.column_stack([size * batches, others])
            found += share * trend_p(residual, unknowns, np.eye(len(residual)) + every @ every.T, trends)
    return found


def smooth_p(fit: Fit, criteria: Criteria) -> float:
    """p-value of offsets that are no smoother over φ and ω than those of a bed that scatters, drawn at each σ_b as
    often as it is likely."""
    residual, unknowns, batches, others = seen = _offsets(fit)
    contrasts, (sizes, share) = free_of(unknowns, others), _scatter(seen, criteria)
    axes, scale, turned = np.linalg.svd(contrasts @ batches, full_matrices=False)
    slope, draw = scale[:, None] * turned, np.random.default_rng(0)
    count, every = slope.shape
    offsets = draw.choice(sizes, (DRAWS, 1), p=share) * draw.standard_normal((DRAWS, every))
    drawn = offsets @ slope.T + draw.standard_normal((DRAWS, count))
    missed = np.concatenate([(axes.T @ (contrasts @ residual))[None], drawn])
    gain = gain_of_any(missed, slope, kernels(_where(fit)[:, :2])) - gain_of_any(missed, slope, [np.eye(every)])
    return float(np.mean(gain >= gain[0]))


def _scatter(offsets: Offsets, criteria: Criteria) -> tuple[Array, Array]:
    """σ_b tried, and how likely each is about a fit."""
    sizes = sizes_tried(criteria.bed_scatter)
    return sizes, probability(gains_of_scatter(*offsets, sizes, criteria.bed_scatter))


def _offsets(fit: Fit) -> Offsets:
    """Whitened residuals without any nuisance, and their slopes by what was fitted, by each batch's ln k, and by the
    other nuisances in units of their priors."""
    residual, unknowns, shift = without_nuisances(fit.problem, fit.state)
    assert fit.nuisances is not None
    sd, batches = fit.nuisances.sd, _batches(fit)
    return residual, unknowns, shift[:, batches], shift[:, ~batches] * sd[~batches]


def _batches(fit: Fit) -> Bool:
    assert fit.nuisances is not None
    return np.array([name == BATCH for name in fit.nuisances.names])


def _where(fit: Fit) -> Array:
    """φ, ω and, where it is told, run order of each batch ``(batches, 2 or 3)``, standardised over cells."""
    cells = fit.cells
    at = np.stack([cells.phi, cells.omega, *([] if cells.order is None else [cells.order])], axis=1)
    return _of_batches(fit, (at - at.mean(axis=0)) / np.maximum(at.std(axis=0), 1e-12))


def _trends(fit: Fit) -> Array:
    """Smooth functions of where and when a batch was, and in which gait ``(batches, t)``."""
    at, gaits = _where(fit), _gaits(fit)
    phi, omega = at[:, 0], at[:, 1]
    trends = np.stack([*at.T, phi**2, omega**2, phi * omega, *gaits.T, *(omega * gaits.T)], axis=1)
    return np.asarray(trends - trends.mean(axis=0))


def _gaits(fit: Fit) -> Array:
    """Share of each batch that is of each gait but the first ``(batches, gaits - 1)``."""
    names = np.array(fit.cells.gait)
    return _of_batches(fit, (names[:, None] == np.unique(names)[1:]).astype(float))


def _of_batches(fit: Fit, of_cells: Array) -> Array:
    """The mean over the trials of each batch ``(batches, n)`` of what cells ``(cells, n)`` have."""
    share = batch_share(fit)
    return np.asarray((share / share.sum(axis=0)).T @ of_cells)


def batch_share(fit: Fit) -> Array:
    """Share of each cell's trials in each batch; every cell is one of its own where no batches are given."""
    given = fit.cells.batch_share
    return np.eye(len(fit.cells)) if given is None else given
