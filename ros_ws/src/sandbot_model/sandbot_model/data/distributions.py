"""Tails and quantiles of the χ², F, t and beta distributions as in scipy.stats, without the time its import takes."""

from typing import Any

from scipy.special import betaincinv, chdtrc, fdtrc, fdtri, gammaincinv, stdtr


def chi2_sf(value: Any, dof: Any) -> Any:
    """Probability that χ² with ``dof`` degrees of freedom is above ``value``; both may be arrays."""
    return chdtrc(dof, value)


def chi2_ppf(probability: float, dof: float) -> float:
    """The value below which χ² with ``dof`` degrees of freedom lies with this probability."""
    return float(2.0 * gammaincinv(0.5 * dof, probability))


def f_sf(value: Any, dof: Any, error_dof: Any) -> Any:
    """Probability that F with ``dof`` and ``error_dof`` degrees of freedom is above ``value``; all may be arrays."""
    return fdtrc(dof, error_dof, value)


def f_isf(tail: float, dof: float, error_dof: float) -> float:
    """The value above which F lies with probability ``tail``."""
    return float(fdtri(dof, error_dof, 1.0 - tail))


def t_sf(value: float, dof: float) -> float:
    """Probability that Student's t with ``dof`` degrees of freedom is above ``value``."""
    return float(stdtr(dof, -value))


def beta_ppf(probability: float, a: float, b: float) -> float:
    """The value below which a beta variate lies with this probability."""
    return float(betaincinv(a, b, probability))
