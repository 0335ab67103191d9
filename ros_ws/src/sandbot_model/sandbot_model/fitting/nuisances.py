"""What trials share and no model is to blame for: offsets of k by batch, drift, and readings off their zero or scale.

Each nuisance u_i is unknown beforehand to sd_i and moves the cell means by a known slope, so that

    ȳ = y(θ, k) + Σ_i slope_i u_i + noise,   u_i ~ N(0, sd_i²)

Those of the bed move k itself in a fit; only what is said about one is linear. A batch shares one offset of ln k: a
random effect, whose sd σ_b is estimated by restricted maximum likelihood (REML; Patterson & Thompson 1971, Biometrika
58, 545), linear about a fit.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sandbot_model.data.distributions import chi2_sf
from sandbot_model.fitting.uncertainty import covariance_of
from sandbot_model.physics.arrays import Array, Bool, Ints

MAX_SCATTER, SIZES = 2.5, 60
"""Largest σ_b, in units of its prior, and how many are tried."""
FARTHER = 2.0
"""How much farther than a verdict grants a bed may scatter by what errors average over."""
LEAST_SHARE = 1e-3
"""Least share of the posterior that is looked at."""


@dataclass(frozen=True, eq=False)
class Nuisances:
    """Names, prior standard deviations ``(m,)`` and d(cell mean)/d(nuisance) ``(cells, 4, m)``, SI units."""

    names: tuple[str, ...]
    sd: Array
    slope: Array
    ln_k_sd: Array
    """Standard deviation of ln k that the replicates of a cell share ``(cells,)``."""
    about: Array
    """Values ``(m,)`` from which a fit begins; of a fit's own, those that it found."""
    by_ln_k: Array
    """d(ln k of a cell)/d(nuisance) ``(cells, m)``, 0 for those that leave k as it is."""

    @cached_property
    def moves_k(self) -> Bool:
        """Which are the bed's ``(m,)``."""
        return np.asarray(self.by_ln_k.any(axis=0))

    @cached_property
    def of_readings(self) -> tuple[Array, Array]:
        """Prior standard deviations ``(n,)`` and slopes ``(cells, 4, n)`` of those that leave k as it is."""
        return self.sd[~self.moves_k], np.ascontiguousarray(self.slope[..., ~self.moves_k])

    def without(self, cells: int | Ints) -> "Nuisances":
        """The same for all cells but these."""
        fewer = (np.delete(each, cells, axis=0) for each in (self.slope, self.ln_k_sd, self.by_ln_k))
        slope, ln_k_sd, by_ln_k = fewer
        return replace(self, slope=slope, ln_k_sd=ln_k_sd, by_ln_k=by_ln_k)

    @property
    def of_one_cell(self) -> Bool:
        """Which are offsets of the bed under a single cell ``(m,)``."""
        return np.asarray(np.count_nonzero(self.by_ln_k, axis=0) == 1)

    def only(self, which: Bool) -> "Nuisances":
        """Some of them ``(m,)``."""
        names = tuple(name for name, kept in zip(self.names, which, strict=True) if kept)
        sd, about, slope, by_ln_k = self.sd[which], self.about[which], self.slope[..., which], self.by_ln_k[:, which]
        return Nuisances(names, sd, slope, self.ln_k_sd, about, by_ln_k)

    def rougher(self, ln_k_sd: float) -> "Nuisances":
        """The same on a bed whose ln k also scatters by so much from condition to condition."""
        return replace(self, ln_k_sd=np.hypot(self.ln_k_sd, ln_k_sd))


def sizes_tried(prior: float) -> Array:
    """σ_b that are tried, 0 first, for the sd of its half-normal prior."""
    return np.linspace(0.0, MAX_SCATTER * prior, SIZES)


def probability(gain: Array) -> Array:
    """Posterior probability of each σ_b tried, of what it gains."""
    weight = np.exp(0.5 * (gain - gain.max()))
    return np.asarray(weight / weight.sum())


def scatter_of_batches(
    residual: Array, jacobian: Array, batches: Array, others: Array, tried: Array, prior: float
) -> tuple[float, float]:
    """σ_b most likely a posteriori of those ``tried``, 0 first, and what it gains; arguments as below."""
    gain = gains_of_scatter(residual, jacobian, batches, others, tried, prior)
    best = int(np.argmax(gain))
    return float(tried[best]), float(gain[best])


def gains_of_scatter(
    residual: Array, jacobian: Array, batches: Array, others: Array, tried: Array, prior: float
) -> Array:
    """What each σ_b ``tried`` gains over none in -2 ln of its posterior.

    ``residual (n,)`` is whitened, ``jacobian (n, p)`` are the slopes of what was fitted, ``batches (n, b)`` those by
    each batch's ln k and ``others (n, m)`` those by the other nuisances in units of their priors; ``prior`` is the sd
    of a half-normal prior of σ_b. Of the contrasts free of all that was fitted, those that batches share have the
    variances 1 + σ_b² s_i².
    """
    contrasts = free_of(jacobian, others)
    axes, shares, _ = np.linalg.svd(contrasts @ batches, full_matrices=False)
    return gains(axes.T @ (contrasts @ residual), shares**2, tried) - (tried / prior) ** 2


def gains_for_errors(
    residual: Array, jacobian: Array, batches: Array, others: Array, prior: float
) -> tuple[Array, Array]:
    """σ_b that errors average over, and what each gains; arguments as above.

    A verdict takes no bed for rougher than beds are; errors must hold on one that is: ``prior`` is the scale of a
    half-Cauchy's (Gelman 2006, Bayesian Analysis 1, 515).
    """
    tried = sizes_tried(FARTHER * prior)
    without_prior = gains_of_scatter(residual, jacobian, batches, others, tried, np.inf)
    return tried, without_prior - 2 * np.log1p((tried / prior) ** 2)


def averaged_moments(
    residual: Array, jacobian: Array, batches: Array, others: Array, tried: Array, gain: Array
) -> Array:
    """Second moments ``(p, p)`` of the unknowns about where they are, over σ_b at its posterior; arguments as above.

    To first order: at each σ_b the covariance of generalised least squares, and how far its estimate is from here.
    """
    found = np.zeros((jacobian.shape[1],) * 2)
    for size, share in zip(tried, probability(gain), strict=True):
        if share > LEAST_SHARE:
            unit = np.column_stack([others, size * batches])
            both = np.column_stack([jacobian, residual])
            free = both - unit @ np.linalg.solve(np.eye(unit.shape[1]) + unit.T @ unit, unit.T @ both)
            covariance = covariance_of(jacobian.T @ free[:, :-1])
            away = covariance @ (jacobian.T @ free[:, -1])
            found += share * (covariance + np.outer(away, away))
    return found


def gains(missed: Array, shares: Array, sizes: Array) -> Array:
    """Fall of -2 ln likelihood of contrasts ``missed (..., n)`` whose variances are 1 + size² ``shares (n,)`` and not
    1, ``(..., sizes)``."""
    variance = 1.0 + np.outer(sizes**2, shares)
    return np.asarray(missed**2 @ (1.0 - 1.0 / variance).T - np.sum(np.log(variance), axis=1))


def free_of(jacobian: Array, others: Array) -> Array:
    """Contrasts ``(n - rank, n)`` of unit variance, free of all that was fitted; arguments as above."""
    white = np.linalg.inv(np.linalg.cholesky(np.eye(len(jacobian)) + others @ others.T))
    basis, singular, _ = np.linalg.svd(white @ jacobian)
    return np.asarray(basis[:, np.count_nonzero(singular > 1e-9 * singular[0]) :].T @ white)


def trend_p(residual: Array, jacobian: Array, covariance: Array, trends: Array) -> float:
    """p-value of no trend left in residuals ``(n,)`` of this covariance; NaN where none could be told.

    A score test: ``jacobian (n, p)`` are the slopes of what was fitted, ``trends (n, t)`` those of what may be there.
    """
    solved = np.linalg.solve(covariance, np.column_stack([jacobian, trends, residual]))
    count = jacobian.shape[1]
    fitted = np.linalg.pinv(jacobian.T @ solved[:, :count], rcond=1e-12, hermitian=True)
    adjusted = solved[:, count:] - solved[:, :count] @ (fitted @ (jacobian.T @ solved[:, count:]))
    pull, information = trends.T @ adjusted[:, -1], trends.T @ adjusted[:, :-1]
    variance, axes = np.linalg.eigh(information)
    determined = variance > 1e-6 * np.trace(trends.T @ solved[:, count:-1])
    score = (axes.T @ pull)[determined] ** 2 / variance[determined]
    return float(chi2_sf(score.sum(), len(score))) if len(score) else float("nan")


def effective(unit: Array) -> float:
    """Unknowns that nuisances amount to: Σ (1 - posterior/prior variance) for slopes ``(n, m)`` in prior units."""
    information = unit.T @ unit
    return float(np.trace(np.linalg.solve(information + np.eye(len(information)), information)))
