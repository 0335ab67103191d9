"""Would another sample of trials have led to the same set? A parametric bootstrap of the cell means.

Each draw adds noise with the cell means' covariance to the data; to first order a set's misfit is then its residual
plus the noise, less what its parameters can absorb. No fit is repeated, so hundreds of draws cost milliseconds. In each
draw an effect must gain what a claim takes (``verdict.claim_threshold``), and a convention what its selection costs.
"""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.verdict import claim_threshold, price_of_conventions
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import project_out, tangent_basis

DRAWS = 400


def win_shares(fits: Sequence[Fit], rng: np.random.Generator, criteria: Criteria = DEFAULT) -> list[float]:
    """Fraction of ``DRAWS`` in which each of the sets is best, by BIC plus the price of a claim for its effects."""
    noise = rng.normal(size=(fits[0].state.all_residuals.size, DRAWS))
    prices = [claim_threshold(fit, criteria) * len(fit.effects) + price_of_conventions(fit) for fit in fits]
    scores = np.stack([_bic(fit, noise) + price for fit, price in zip(fits, prices, strict=True)])
    winners = scores.argmin(axis=0)
    return [float(np.mean(winners == index)) for index in range(len(fits))]


def _bic(fit: Fit, noise: Floats) -> Floats:
    """BIC in each draw ``(draws,)``; ``noise (4 cells, draws)`` is that of the cell means, whitened by pure error."""
    problem, state = fit.problem, fit.state
    values = problem.measured.size
    # From the whitening by pure error to that of this set, which may give a cell near a switch less weight.
    rewhiten = state.whiten[0] @ np.linalg.inv(problem.whiten)
    moved = np.einsum("cij,cjd->cid", rewhiten, noise[:values].reshape(*problem.measured.shape, -1))
    moved = np.where(problem.measured[:, :, None], moved, 0.0).reshape(values, -1)
    residual = state.all_residuals[0][:, None] + np.concatenate([moved, noise[values:]])
    remaining = project_out(residual, tangent_basis(problem, state))
    return np.asarray(np.sum(remaining**2, axis=0) + fit.bic - fit.goodness.chi2)
