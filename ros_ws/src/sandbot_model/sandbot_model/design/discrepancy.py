"""An unknown alternative to all candidate models: a smooth discrepancy on top of the leading fit.

δ ~ GP(0, (g σ)² exp(-½ (Δφ/ℓ_φ)² - ½ (Δω/ℓ_ω)²)) in each observable, σ the scatter of one trial. It attracts trials to
unexplored conditions, so that a design does not look only where its candidate models differ.
"""

from dataclasses import replace

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.design.explanations import Explanation, explained_by
from sandbot_model.design.places import Places, scatter_of_one
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import Observable

ELSE = "something else"
LENGTH = 0.25
"""ℓ, relative to the range of the plan."""


def something_else(fit: Fit, places: Places, gross: float) -> Explanation:
    """The fit plus a discrepancy with g = ``gross``, conditioned on the residuals of the trials so far."""
    leading = explained_by(fit, places)
    cells = fit.cells
    at = np.stack([places.phi, places.omega], axis=-1)
    seen = np.stack([cells.level_phi[cells.level], cells.omega], axis=-1)
    span = np.maximum(np.ptp(at, axis=0), 1e-12) * LENGTH
    mean, common = leading.mean.copy(), leading.common.copy()
    sigma, residual = scatter_of_one(cells), cells.mean - fit.predicted
    # Whether cells near the switch walk is a matter of chance, so their residuals say nothing of a discrepancy.
    clear = fit.problem.away_from_switch(fit.problem.widening(fit.state.covariance[0]))
    for o in Observable:
        had = np.isfinite(cells.mean[:, o]) & clear
        error = cells.covariance[had, o, o] / sigma[o] ** 2
        missed = residual[had, o] / sigma[o]
        prior = gross**2 * _correlation(seen[had], seen[had], span) + np.diag(error)
        cross = gross**2 * _correlation(at, seen[had], span)
        gain = np.linalg.solve(prior, np.column_stack([missed, cross.T])) if had.any() else np.zeros((0, 1 + len(at)))
        # In standard deviations of one trial at the place, which are wider where the scatter of φ matters.
        scale = sigma[o] * places.precision[:, o]
        posterior = gross**2 * _correlation(at, at, span) - cross @ gain[:, 1:]
        mean[:, o] += scale * (cross @ gain[:, 0])
        common[:, o, :, o] += scale[:, None] * posterior * scale
    return replace(leading, name=ELSE, mean=mean, common=common)


def _correlation(first: Floats, second: Floats, span: Floats) -> Floats:
    distance = (first[:, None] - second) / span
    return np.asarray(np.exp(-0.5 * np.sum(distance**2, axis=-1)))
