"""The steepest or the highest point of a folded step (``fold``).

The curve has kinks where the leg catches and lets go, so a global smoother is unsuitable. A local cubic is fitted in
windows of many centres and widths, and for each centre the widest window is kept whose residuals are noise (Lepski's
rule): such a window ends before a kink, and spans the whole step where the robot swims, so noise is not mistaken for a
peak.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_tracking.fold import Folded, NotMeasured, check_in_step, fold, grouped, inside, progress

_CENTRES = 60
_WIDTHS = 0.5 * 0.85 ** np.arange(22)
"""Half-widths of windows, in steps: 0.5 down to 0.017 (the stance of a step of 0.3 R spans 0.095; with a soft-ground
clock signal the fast end of one of 0.8 R 0.08)."""
_MAX_GAP = 0.4
"""Largest gap between the points of a cubic whose slope is used, in half-widths. A cubic fits any four groups of points
and may be too steep where a kink is in a gap, so no fifth of its window may be empty. At ω = 24 rad/s a step has 13.09
frames: the phases of a few steps are in groups, with such gaps between them."""
_GROUP = 4
"""Points averaged for each end of a secant."""
_MIN_SECANT = 0.003
"""Smallest length of a secant, in steps."""
_MAX_RATIO = 1.1
"""Ratio of the steepest secant to the largest fitted slope, or of the highest mean of a few points to the largest
fitted level, from which some arc was too short for every window."""
_FLAT_M = 1e-4
"""A level below it need not be resolved."""


@dataclass(frozen=True)
class _Fit:
    slope: float
    level: float
    slope_se: float
    level_se: float


def peak_slope(t_s: Floats, x_m: Floats, edges_s: Floats, rest_m: Floats) -> float:
    """Largest dx/dt of the folded step [m/s], from frames ``t_s``, ``x_m (n,)``.

    ``rest_m``: position at each of the ``edges_s (steps + 1,)``. Raises NotMeasured.
    """
    number, x = inside(t_s, x_m, edges_s)
    step = number.astype(int)
    lengths = np.diff(rest_m)
    length = lengths[step]
    # Of steps that were tracked to both their ends; there may be none.
    mean = float(np.nanmean(lengths)) if np.isfinite(lengths).any() else np.nan
    seconds = float(np.median(np.diff(edges_s)))
    # Differences in step length are removed in proportion, which leaves the shape at the mean length.
    part = (x - rest_m[step]) - (length - mean) * progress(number % 1.0, x - rest_m[step], length)
    folded = fold(number % 1.0, part, mean)
    line = _featureless(folded, degree=1)
    if line is not None:
        return line.slope / seconds
    check_in_step(number, part - mean * (number % 1.0))
    best = _best(folded, lambda fit: fit.slope - 5 * fit.slope_se, _MAX_GAP)
    secant = _steepest_secant(folded)
    if secant > _MAX_RATIO * best.slope:
        found = f"{best.slope / seconds:.4f} m/s where it moves at {secant / seconds:.4f} m/s at least"
        raise NotMeasured(f"an arc too short to resolve ({found})")
    return best.slope / seconds


def peak_height(t_s: Floats, z_m: Floats, edges_s: Floats) -> float:
    """Largest z of the folded step [m], median over the steps, from frames ``t_s``, ``z_m (n,)``; the plain mean if the
    folded curve is flat.

    Raises NotMeasured.
    """
    number, z = inside(t_s, z_m, edges_s)
    folded = fold(number % 1.0, z, 0.0)
    flat = _featureless(folded, degree=0)
    if flat is not None:
        return flat.level
    check_in_step(number, z)
    top = _best(folded, lambda fit: fit.level - 5 * fit.level_se).level
    highest = _highest_group(folded)
    if highest > _MAX_RATIO * max(top, _FLAT_M):
        raise NotMeasured(f"a top too short to resolve ({top:.5f} m where it is at {highest:.5f} m at least)")
    return top * _median_scale(number, z, folded)


def _best(folded: Folded, merit: Callable[[_Fit], float], max_gap: float = np.inf) -> _Fit:
    centres = (np.arange(_CENTRES) + 0.5) / _CENTRES
    fits = [fit for centre in centres if (fit := _widest(folded, centre, max_gap)) is not None]
    if not fits:
        raise NotMeasured("the folded step is not sampled finely enough: more steps or another ω are needed")
    return max(fits, key=merit)


def _steepest_secant(folded: Folded) -> float:
    """Lower bound of the steepest slope: the steepest secant between means of a few points, less 5 standard errors."""
    middle, level, level_se = _groups(folded)
    found = 0.0
    for apart in (1, 2, 3):
        span, rise = middle[apart:] - middle[:-apart], level[apart:] - level[:-apart]
        se = np.hypot(level_se[apart:], level_se[:-apart])
        # If steps last a whole number of frames, many points have the same phase.
        wide = span > _MIN_SECANT
        found = max(found, float(np.max((rise - 5 * se)[wide] / span[wide], initial=0.0)))
    return found


def _highest_group(folded: Folded) -> float:
    """Lower bound of the highest level: the highest mean of a few neighbours, less 5 standard errors."""
    _, level, se = _groups(folded)
    return float(np.max(level - 5 * se))


def _groups(folded: Folded) -> tuple[Floats, Floats, Floats]:
    """Phase, value and its standard error, of means of a few neighbours in phase."""
    phase, value, deviation = (grouped(array, _GROUP) for array in (folded.phase, folded.value, folded.deviation))
    noise = np.maximum(1.4826 * np.median(np.abs(deviation), axis=1), folded.noise)
    return phase.mean(axis=1), value.mean(axis=1), noise / np.sqrt(_GROUP)


def _widest(folded: Folded, centre: float, max_gap: float) -> _Fit | None:
    """The more precise of a line and a cubic, each in its widest window, less a margin as a kink is detected late."""
    # Imported only here, so that reading a table does not wait for the compiler.
    from sandbot_tracking.windows import widest_fit

    points = folded.phase, folded.value, folded.deviation, folded.noise, folded.advance
    found, fit = widest_fit(*points, centre, _WIDTHS, max_gap)
    return _Fit(*fit) if found else None


def _featureless(folded: Folded, degree: int) -> _Fit | None:
    """A line or a constant over the whole step; None if that does not fit.

    Lack of fit against pure error: the mean residual over each twelfth of the step must be within 3.5 standard errors,
    estimated from the scatter within the twelfths. Unlike the noise between neighbours in phase, that scatter includes
    the errors of rest positions, which all frames of a step share.
    """
    u = 2 * folded.phase - 1
    if degree and np.ptp(u) < _MIN_SECANT:
        return None  # one frame per step: a single phase does not determine a line
    design = u[:, None] ** np.arange(degree + 1)
    covariance = np.linalg.inv(design.T @ design)
    solution = covariance @ (design.T @ folded.value)
    residual = folded.value - design @ solution
    part = np.minimum((6 * (u + 1)).astype(int), 11)
    count = np.maximum(np.bincount(part, minlength=12), 1)
    mean = np.bincount(part, residual, 12) / count
    scatter = float(np.sum((residual - mean[part]) ** 2)) / max(u.size - 12, 1)
    if (np.abs(mean) * np.sqrt(count) > 3.5 * max(np.sqrt(scatter), 1e-7)).any():
        return None
    slope, slope_se = (2 * solution[1], 2 * np.sqrt(scatter * covariance[1, 1])) if degree else (0.0, 0.0)
    return _Fit(float(slope), float(solution[0]), float(slope_se), float(np.sqrt(scatter * covariance[0, 0])))


def _median_scale(number: Floats, z: Floats, folded: Folded) -> float:
    """Median over steps of a step's height relative to the folded curve (least squares on its shape)."""
    shape = _smooth(folded, number % 1.0)
    seen = np.isfinite(z)
    step = number.astype(int)
    power = np.bincount(step[seen], shape[seen] ** 2)
    scale = (
        np.bincount(step[seen], shape[seen] * z[seen])[power > 4 * folded.noise**2] / power[power > 4 * folded.noise**2]
    )
    return float(np.median(scale)) if scale.size else 1.0


def _smooth(folded: Folded, phase: Floats) -> Floats:
    """The folded curve at the given phases, from means over neighbours in phase."""
    size = max(1, folded.phase.size // 40)
    middle, level = (grouped(values, size).mean(axis=1) for values in (folded.phase, folded.value))
    return np.asarray(np.interp(phase, middle, level, period=1.0), dtype=float)
