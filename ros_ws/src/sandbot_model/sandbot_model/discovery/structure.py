"""Whether the offsets of batches are random: a bed that scatters follows nothing, a model that is wrong does.

A missing effect that is granted to the bed, condition by condition, leaves offsets of ln k with a trend over φ, ω or
the order, or smooth over φ and ω at some length.
"""

import numpy as np

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.smooth import gain_of_any, kernels
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import without_nuisances
from sandbot_model.fitting.nuisances import free_of, trend_p
from sandbot_model.physics.arrays import Array, Bool

BATCH = "ln_k"
"""Name of every batch's offset."""
STRUCTURE = 0.01
"""p-value below which offsets follow a trend, and are no nuisance."""


def at_random(fit: Fit, criteria: Criteria) -> bool:
    """Whether the batches' offsets follow nothing: neither a trend nor anything smooth."""
    if fit.nuisances is None or BATCH not in fit.nuisances.names:
        return True
    return structure_p(fit) >= STRUCTURE and smoothness(fit) <= criteria.shared


def structure_p(fit: Fit) -> float:
    """p-value of no trend of the batches' offsets over φ, ω (to second order) and run order."""
    residual, unknowns, batches, others = _offsets(fit)
    assert fit.nuisances is not None
    every = np.column_stack([fit.nuisances.sd[_batches(fit)] * batches, others])
    return trend_p(residual, unknowns, np.eye(len(residual)) + every @ every.T, batches @ _trends(fit))


def smoothness(fit: Fit) -> float:
    """By how much more offsets that are smooth over φ and ω gain in -2 ln likelihood than offsets at random."""
    residual, unknowns, batches, others = _offsets(fit)
    contrasts = free_of(unknowns, others)
    missed, slope = contrasts @ residual, contrasts @ batches
    scatter = gain_of_any(missed, slope, [np.eye(batches.shape[1])])
    return gain_of_any(missed, slope, kernels(_where(fit)[:, :2])) - scatter


def _offsets(fit: Fit) -> tuple[Array, Array, Array, Array]:
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
    share, cells = batch_share(fit), fit.cells
    at = np.stack([cells.phi, cells.omega, *([] if cells.order is None else [cells.order])], axis=1)
    return np.asarray((share / share.sum(axis=0)).T @ ((at - at.mean(axis=0)) / np.maximum(at.std(axis=0), 1e-12)))


def _trends(fit: Fit) -> Array:
    """Smooth functions of where and when a batch was ``(batches, t)``."""
    at = _where(fit)
    phi, omega = at[:, 0], at[:, 1]
    trends = np.stack([*at.T, phi**2, omega**2, phi * omega], axis=1)
    return np.asarray(trends - trends.mean(axis=0))


def batch_share(fit: Fit) -> Array:
    """Share of each cell's trials in each batch; every cell is one of its own where no batches are given."""
    given = fit.cells.batch_share
    return np.eye(len(fit.cells)) if given is None else given
