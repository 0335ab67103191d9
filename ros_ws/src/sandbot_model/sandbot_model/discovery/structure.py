"""Whether the offsets of batches are random: a bed that scatters follows nothing, a model that is wrong does.

A missing effect that is granted to the bed, condition by condition, leaves offsets of ln k with a trend over φ, ω or
the order, or from gait to gait, or smooth over φ and ω at some length. So do zeros and scales of batches.
"""

import numpy as np

from sandbot_model.discovery.batch_sd import BATCH, batch_sd_of, priors
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
from sandbot_model.physics.arrays import Array

STRUCTURE = 0.005
"""p-value of either test below which offsets follow something, and are no nuisance."""
Offsets = tuple[Array, Array, Array, Array]
"""See ``_offsets``."""
DRAWS = 1000
"""Beds drawn that scatter at random: few batches look smooth more often than many."""


def at_random(fit: Fit, criteria: Criteria) -> bool:
    """Whether the batches' offsets follow nothing: neither a trend nor anything smooth."""
    if fit.nuisances is None:
        return True
    # Blocks that each hold all of φ and ω, in no order that is told, have no trend.
    found = [p(fit, criteria, name) for name in batch_sd_of(fit).names for p in (trend_p_of, smooth_p)]
    return not found or bool(np.nanmin(found) >= STRUCTURE)


def trend_p_of(fit: Fit, criteria: Criteria, name: str = BATCH) -> float:
    """p-value of no trend over φ, ω (to second order), run order and gait of what each batch has of this name.

    Averaged over how far batches may differ; NaN where there is no such trend.
    """
    residual, unknowns, batches, others = seen = _offsets(fit, name)
    trends, found = batches @ _trends(fit), 0.0
    for size, share in zip(*_scatter(seen, priors(fit, criteria)[name]), strict=True):
        if share > LEAST_SHARE:
            every = np.column_stack([size * batches, others])
            found += share * trend_p(residual, unknowns, np.eye(len(residual)) + every @ every.T, trends)
    return found


def smooth_p(fit: Fit, criteria: Criteria, name: str = BATCH) -> float:
    """p-value of offsets that are no smoother over φ and ω than those of a bed that scatters, drawn at each σ_b as
    often as it is likely."""
    residual, unknowns, batches, others = seen = _offsets(fit, name)
    contrasts, (sizes, share) = free_of(unknowns, others), _scatter(seen, priors(fit, criteria)[name])
    axes, scale, turned = np.linalg.svd(contrasts @ batches, full_matrices=False)
    slope, draw = scale[:, None] * turned, np.random.default_rng(0)
    count, every = slope.shape
    offsets = draw.choice(sizes, (DRAWS, 1), p=share) * draw.standard_normal((DRAWS, every))
    drawn = offsets @ slope.T + draw.standard_normal((DRAWS, count))
    missed = np.concatenate([(axes.T @ (contrasts @ residual))[None], drawn])
    gain = gain_of_any(missed, slope, kernels(_where(fit)[:, :2])) - gain_of_any(missed, slope, [np.eye(every)])
    return float(np.mean(gain >= gain[0]))


def _scatter(offsets: Offsets, prior: float) -> tuple[Array, Array]:
    """Standard deviations tried, and how likely each is about a fit."""
    sizes = sizes_tried(prior)
    return sizes, probability(gains_of_scatter(*offsets, sizes, prior))


def _offsets(fit: Fit, name: str) -> Offsets:
    """Whitened residuals without any nuisance, and their slopes by what was fitted, by what each batch has of this
    name, and by the other nuisances in units of their priors."""
    residual, unknowns, shift = without_nuisances(fit.problem, fit.state)
    assert fit.nuisances is not None
    sd, batches = fit.nuisances.sd, np.array([own == name for own in fit.nuisances.names])
    return residual, unknowns, shift[:, batches], shift[:, ~batches] * sd[~batches]


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
