"""Compiled polynomial fits in windows of a folded step: the widest window around a centre whose residuals are noise."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

import numpy as np

from sandbot_common.compiled import compiled
from sandbot_tracking.fold import MIN_NOISE, MIN_POINTS

MARGIN = 0.85
"""Fraction of the widest window that is used, as a kink is detected late."""


@compiled
def widest_fit(phase, value, deviation, noise, advance, centre, widths, max_gap):
    """Whether one of the decreasing ``widths`` fits; slope, level and their standard errors, of a line or a cubic.

    A cubic is fitted only where its points are at most ``max_gap`` half-widths apart.
    """
    best, found = (0.0, 0.0, 0.0, 0.0), False
    for degree in (1, 3):
        gap = max_gap if degree == 3 else np.inf
        for half in widths:
            good, fit = _fit(phase, value, deviation, noise, advance, centre, half, degree, gap)
            if good:
                better, narrower = _fit(phase, value, deviation, noise, advance, centre, MARGIN * half, degree, gap)
                fit = narrower if better else fit
                if not found or fit[2] < best[2]:
                    best, found = fit, True
                break
    return found, best


@compiled
def _fit(phase, value, deviation, noise, advance, centre, half, degree, max_gap):
    """A polynomial fit in [centre ± half], periodic in the step; False if residuals are not noise."""
    nothing = (0.0, 0.0, 0.0, 0.0)
    turns = np.floor(phase - centre + 0.5)
    place = (phase - centre - turns) / half
    inside = np.abs(place) <= 1.0
    u, y = place[inside], (value - advance * turns)[inside]
    if u.size < max(MIN_POINTS, degree + 2) or not (u.min() < -0.5 and u.max() > 0.5):
        return False, nothing  # the slope would be an extrapolation
    if not _spread_out(u, degree + 3, max_gap):
        return False, nothing
    design = np.ones((u.size, degree + 1))
    for power in range(1, degree + 1):
        design[:, power] = design[:, power - 1] * u
    covariance = np.linalg.inv(design.T @ design)
    solution = covariance @ (design.T @ y)
    noise = max(noise, 1.4826 * np.median(np.abs(deviation[inside])), MIN_NOISE)
    residual = (y - design @ solution) / noise
    free = u.size - degree - 1
    if residual @ residual > 1.2 * _chi2_99(free) or _runs(residual, u):
        return False, nothing
    slope_se, level_se = np.sqrt(covariance[1, 1]) * noise / half, np.sqrt(covariance[0, 0]) * noise
    return True, (solution[1] / half, solution[0], slope_se, level_se)


@compiled
def _spread_out(u, least, max_gap):
    """Whether there are ``least`` distinct places, none farther than ``max_gap`` from the next."""
    gaps = np.diff(np.sort(u))
    return np.count_nonzero(gaps > 0.01) + 1 >= least and gaps.max() <= max_gap


@compiled
def _chi2_99(free):
    """99 % quantile of χ² (Wilson–Hilferty; within 1 % from 3 degrees of freedom on)."""
    part = 2.0 / (9.0 * free)
    return free * (1.0 - part + 2.3263 * np.sqrt(part)) ** 3


@compiled
def _runs(residual, u):
    """Whether residuals are systematic: the mean over some eighth of the window exceeds 3.5 standard errors."""
    count, total = np.zeros(8), np.zeros(8)
    for i in range(u.size):
        part = min(int((u[i] + 1) * 4), 7)
        count[part] += 1
        total[part] += residual[i]
    return np.abs(total / np.sqrt(np.maximum(count, 1.0))).max() > 3.5
