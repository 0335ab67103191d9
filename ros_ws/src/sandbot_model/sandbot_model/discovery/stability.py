"""Would another sample of trials have led to the same set? A parametric bootstrap of the cell means.

What an effect must bring to be claimed (``verdict.claim_threshold``) it must bring in each draw.

Each draw adds noise of the cell means' own covariance to the data; to first order a set's misfit is then that of its
residual plus the noise, projected out of what its parameters can absorb. No fit is repeated, so hundreds of draws cost
milliseconds.
"""

from collections.abc import Sequence

import numpy as np

from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.verdict import claim_threshold
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import project_out, tangent_basis
from sandbot_model.physics.arrays import Array

DRAWS = 400


def win_shares(
    fits: Sequence[Fit], rng: np.random.Generator, draws: int = DRAWS, criteria: Criteria = DEFAULT
) -> list[float]:
    """Share of draws in which each set has the least BIC, plus the claim for every effect in it, of all given."""
    noise = rng.normal(size=(fits[0].state.all_residuals.size, draws))
    scores = np.stack([_bic(fit, noise) + claim_threshold(fit, criteria) * len(fit.effects) for fit in fits])
    winners = scores.argmin(axis=0)
    return [float(np.mean(winners == index)) for index in range(len(fits))]


def _bic(fit: Fit, noise: Array) -> Array:
    """BIC in each draw ``(draws,)``; ``noise (4 cells, draws)`` is white in the pure error's own frame."""
    problem, state = fit.problem, fit.state
    cells = len(fit.cells)
    # From the pure error's frame to that of this set, which may weigh a cell beside a switch less.
    turn = state.whiten[0] @ np.linalg.inv(problem.whiten)
    moved = np.einsum("cij,cjd->cid", turn, noise[: 4 * cells].reshape(cells, 4, -1))
    moved = np.where(problem.measured[:, :, None], moved, 0.0).reshape(4 * cells, -1)
    residual = state.all_residuals[0][:, None] + np.concatenate([moved, noise[4 * cells :]])
    remaining = project_out(residual, tangent_basis(problem, state))
    return np.asarray(np.sum(remaining**2, axis=0) + fit.bic - fit.goodness.chi2)
