"""Something else: a smooth discrepancy that nobody has a name for, on top of the leading fit.

δ ~ GP(0, (g σ)² exp(-½ (Δφ/ℓ_φ)² - ½ (Δω/ℓ_ω)²)) in each observable, σ the scatter of one trial. It sends trials to
where none have been, and keeps a design from looking only where its own models differ.
"""

from dataclasses import replace

import numpy as np

from sandbot_model.design.explanations import Explanation, explained_by
from sandbot_model.design.places import Places, scatter_of_one
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.observables import Observable

ELSE = "something else"
LENGTH = 0.25
"""ℓ, in units of what the plan spans."""


def something_else(fit: Fit, places: Places, gross: float) -> Explanation:
    """The fit and a discrepancy of g = ``gross``, as it is known after the trials so far."""
    by = explained_by(fit, places)
    cells = fit.cells
    at = np.stack([places.phi, places.omega], axis=-1)
    seen = np.stack([cells.level_phi[cells.level], cells.omega], axis=-1)
    span = np.maximum(np.ptp(at, axis=0), 1e-12) * LENGTH
    mean, common = by.mean.copy(), by.common.copy()
    sigma, residual = scatter_of_one(cells), cells.mean - fit.predicted
    # What walks or swims by chance is missed by every model that does not toss the same coin.
    clear = fit.problem.away_from_switch(fit.problem.widening(fit.state.covariance[0]))
    for one in Observable:
        had = np.isfinite(cells.mean[:, one]) & clear
        error = cells.covariance[had, one, one] / sigma[one] ** 2
        missed = residual[had, one] / sigma[one]
        known = gross**2 * _alike(seen[had], seen[had], span) + np.diag(error)
        there = gross**2 * _alike(at, seen[had], span)
        gain = np.linalg.solve(known, np.column_stack([missed, there.T])) if had.any() else np.zeros((0, 1 + len(at)))
        # In standard deviations of one trial at the place, which are wider where the bed's misses of φ show.
        scale = sigma[one] * places.precision[:, one]
        left = gross**2 * _alike(at, at, span) - there @ gain[:, 1:]
        mean[:, one] += scale * (there @ gain[:, 0])
        common[:, one, :, one] += scale[:, None] * left * scale
    return replace(by, name=ELSE, mean=mean, common=common)


def _alike(first: Array, second: Array, span: Array) -> Array:
    away = (first[:, None] - second) / span
    return np.asarray(np.exp(-0.5 * np.sum(away**2, axis=-1)))
