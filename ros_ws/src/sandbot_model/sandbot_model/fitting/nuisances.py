"""Nuisance parameters, for errors that trials share: offsets of k by batch, drift, zero offsets and scale errors.

Each nuisance u_i has a Gaussian prior of standard deviation sd_i and moves the cell means by a known slope, so that

    ȳ = y(θ, k) + Σ_i slope_i u_i + noise,   u_i ~ N(mean_i, sd_i²)

In a fit, those of the bed move k itself; only the estimates about a fit below are linear. A batch shares one offset of
ln k: a random effect, whose sd σ_b is estimated by restricted maximum likelihood (REML; Patterson & Thompson 1971,
Biometrika 58, 545), linearised about a fit.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.data.distributions import chi2_sf
from sandbot_model.fitting.uncertainty import covariance_of

MAX_SCATTER, SIZES = 2.5, 60
"""Largest σ_b tried, in units of its prior's sd, and how many values are tried."""
FARTHER = 2.0
"""Factor by which the σ_b that standard errors average over may exceed the largest that a verdict allows."""
LEAST_SHARE = 1e-3
"""Values of σ_b with less of the posterior than this are skipped."""


@dataclass(frozen=True, eq=False)
class Nuisances:
    """Names, prior standard deviations ``(m,)`` and d(cell mean)/d(nuisance) ``(cells, 4, m)``, SI units."""

    names: tuple[str, ...]
    sd: Floats
    slope: Floats
    ln_k_sd: Floats
    """Standard deviation of ln k that the replicates of a cell share ``(cells,)``."""
    initial: Floats
    """Values ``(m,)`` from which a fit begins; in a fit's own ``nuisances``, the fitted values."""
    by_ln_k: Floats
    """d(ln k of a cell)/d(nuisance) ``(cells, m)``, 0 for those that do not act on k."""
    mean: Floats = field(default_factory=lambda: np.zeros(1))
    """Means of the priors ``(m,)`` or ``(1,)``; 0 for those of readings."""

    @cached_property
    def moves_k(self) -> Bools:
        """Which nuisances are offsets of the bed ``(m,)``."""
        return np.asarray(self.by_ln_k.any(axis=0))

    @cached_property
    def starts(self) -> Floats:
        """Values ``(rows, m)`` from which a search begins: the initial ones, also with trends of k shifted by their sd.

        Trials run in order of ω may leave a drift behind a switch to swimming, where no slope leads to it.
        """
        trends = (self.by_ln_k < 0).any(axis=0) & (self.by_ln_k > 0).any(axis=0)
        shifts = (0.0, -1.0, 1.0) if trends.any() else (0.0,)
        return np.asarray(self.initial + np.outer(shifts, np.where(trends, self.sd, 0.0)))

    @cached_property
    def of_readings(self) -> tuple[Floats, Floats]:
        """Prior standard deviations ``(n,)`` and slopes ``(cells, 4, n)`` of the zero offsets and scale errors."""
        return self.sd[~self.moves_k], np.ascontiguousarray(self.slope[..., ~self.moves_k])

    def without(self, cells: int | Ints) -> "Nuisances":
        """The same for all cells but these."""
        fewer = (np.delete(each, cells, axis=0) for each in (self.slope, self.ln_k_sd, self.by_ln_k))
        slope, ln_k_sd, by_ln_k = fewer
        return replace(self, slope=slope, ln_k_sd=ln_k_sd, by_ln_k=by_ln_k)

    @property
    def of_one_cell(self) -> Bools:
        """Which are offsets of the bed under a single cell ``(m,)``."""
        return np.asarray(np.count_nonzero(self.by_ln_k, axis=0) == 1)

    def only(self, which: Bools) -> "Nuisances":
        """Some of them ``(m,)``."""
        names = tuple(name for name, kept in zip(self.names, which, strict=True) if kept)
        slope, by_ln_k = self.slope[..., which], self.by_ln_k[:, which]
        mean = np.broadcast_to(self.mean, self.sd.shape)[which]
        return Nuisances(names, self.sd[which], slope, self.ln_k_sd, self.initial[which], by_ln_k, mean)

    def and_reading(self, name: str, sd: float, slope: Floats) -> "Nuisances":
        """The same and, last, a zero or scale of the readings that moves cell means by ``slope (cells, 4)``."""
        names, slopes = (*self.names, name), np.concatenate([self.slope, slope[..., None]], axis=-1)
        initial, by_ln_k = np.append(self.initial, 0.0), np.pad(self.by_ln_k, ((0, 0), (0, 1)))
        mean = np.append(np.broadcast_to(self.mean, self.sd.shape), 0.0)
        return Nuisances(names, np.append(self.sd, sd), slopes, self.ln_k_sd, initial, by_ln_k, mean)

    def with_k_scatter(self, ln_k_sd: float) -> "Nuisances":
        """The same with an additional scatter of ln k from condition to condition, of this standard deviation."""
        return replace(self, ln_k_sd=np.hypot(self.ln_k_sd, ln_k_sd))


def sizes_tried(prior: float) -> Floats:
    """Grid ``(sizes,)`` of σ_b, 0 first; ``prior`` is the sd of its half-normal prior."""
    return np.linspace(0.0, MAX_SCATTER * prior, SIZES)


def probability(gain: Floats) -> Floats:
    """Posterior probability of each σ_b tried, from its ``gain (sizes,)`` in -2 ln posterior."""
    weight = np.exp(0.5 * (gain - gain.max()))
    return np.asarray(weight / weight.sum())


def scatter_of_batches(
    residual: Floats, jacobian: Floats, batches: Floats, others: Floats, tried: Floats, prior: float
) -> tuple[float, float]:
    """Posterior mode of σ_b among those ``tried``, 0 first, and its gain; arguments as in ``gains_of_scatter``."""
    gain = gains_of_scatter(residual, jacobian, batches, others, tried, prior)
    best = int(np.argmax(gain))
    return float(tried[best]), float(gain[best])


def gains_of_scatter(
    residual: Floats, jacobian: Floats, batches: Floats, others: Floats, tried: Floats, prior: float
) -> Floats:
    """Fall of -2 ln posterior from σ_b = 0 to each σ_b ``tried``.

    ``residual (n,)`` is whitened; ``jacobian (n, p)`` are its derivatives by the fitted unknowns, ``batches (n, b)`` by
    each batch's ln k and ``others (n, m)`` by the other nuisances in units of their priors; ``prior`` is the sd of a
    half-normal prior of σ_b. The error contrasts (orthogonal to everything fitted) along the batches have variances
    1 + σ_b² s_i², s_i the singular values of the projected ``batches``.
    """
    contrasts = free_of(jacobian, others)
    axes, shares, _ = np.linalg.svd(contrasts @ batches, full_matrices=False)
    return gains(axes.T @ (contrasts @ residual), shares**2, tried) - (tried / prior) ** 2


def gains_for_errors(
    residual: Floats, jacobian: Floats, batches: Floats, others: Floats, prior: float
) -> tuple[Floats, Floats]:
    """Grid of σ_b that standard errors average over, and the gain of each; arguments as in ``gains_of_scatter``.

    For a verdict σ_b has a half-normal prior; standard errors must also hold for a bed that scatters more than usual:
    ``prior`` is here the scale of a half-Cauchy prior (Gelman 2006, Bayesian Analysis 1, 515).
    """
    tried = sizes_tried(FARTHER * prior)
    without_prior = gains_of_scatter(residual, jacobian, batches, others, tried, np.inf)
    return tried, without_prior - 2 * np.log1p((tried / prior) ** 2)


def averaged_moments(
    residual: Floats, jacobian: Floats, batches: Floats, others: Floats, tried: Floats, gain: Floats
) -> Floats:
    """Second moments ``(p, p)`` of the unknowns about the fit, averaged over the posterior of σ_b; arguments as above.

    To first order: at each σ_b the covariance of generalised least squares, plus the square of its estimate's distance
    from the fit.
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


def averaged_estimate(
    contrasts: Floats, batches: Floats, others: Floats, tried: Floats, gain: Floats
) -> tuple[float, float]:
    """Mean and standard deviation of the first of ``others``, in units of its prior, from ``contrasts`` that hold
    nothing else that is fitted, averaged over the posterior of σ_b; arguments as above."""
    weight, means, variances = probability(gain), [], []
    for size in tried:
        unit = np.column_stack([others, size * batches])
        covariance = np.linalg.inv(np.eye(unit.shape[1]) + unit.T @ unit)
        means.append(covariance[0] @ (unit.T @ contrasts))
        variances.append(covariance[0, 0])
    mean = float(weight @ means)
    return mean, float(np.sqrt(weight @ (np.array(variances) + (np.array(means) - mean) ** 2)))


def gains(missed: Floats, shares: Floats, sizes: Floats) -> Floats:
    """Fall of -2 ln likelihood ``(..., sizes)`` of contrasts ``missed (..., n)`` if their variances are 1 + size²
    ``shares (n,)`` instead of 1."""
    variance = 1.0 + np.outer(sizes**2, shares)
    return np.asarray(missed**2 @ (1.0 - 1.0 / variance).T - np.sum(np.log(variance), axis=1))


def free_of(jacobian: Floats, others: Floats) -> Floats:
    """Error contrasts ``(n - rank, n)``: of unit variance, orthogonal to everything fitted; arguments as above."""
    white = np.linalg.inv(np.linalg.cholesky(np.eye(len(jacobian)) + others @ others.T))
    basis, singular, _ = np.linalg.svd(white @ jacobian)
    return np.asarray(basis[:, np.count_nonzero(singular > 1e-9 * singular[0]) :].T @ white)


def trend_p(residual: Floats, jacobian: Floats, covariance: Floats, trends: Floats) -> float:
    """p-value of no trend left in residuals ``(n,)`` of this covariance; NaN where no trend could be distinguished.

    A score test: ``jacobian (n, p)`` are the derivatives by what was fitted, ``trends (n, t)`` by the trends tested.
    """
    solved = np.linalg.solve(covariance, np.column_stack([jacobian, trends, residual]))
    count = jacobian.shape[1]
    fitted = covariance_of(jacobian.T @ solved[:, :count])
    adjusted = solved[:, count:] - solved[:, :count] @ (fitted @ (jacobian.T @ solved[:, count:]))
    pull, information = trends.T @ adjusted[:, -1], trends.T @ adjusted[:, :-1]
    variance, axes = np.linalg.eigh(information)
    determined = variance > 1e-6 * np.trace(trends.T @ solved[:, count:-1])
    score = (axes.T @ pull)[determined] ** 2 / variance[determined]
    return float(chi2_sf(score.sum(), len(score))) if len(score) else float("nan")


def effective(unit: Floats) -> float:
    """Effective number of fitted nuisances: Σ (1 - posterior/prior variance) for slopes ``(n, m)`` in prior units."""
    information = unit.T @ unit
    return float(np.trace(np.linalg.solve(information + np.eye(len(information)), information)))
