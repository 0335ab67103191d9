"""All steps folded onto one phase axis, and the steepest or highest point of the folded curve.

At ω = 30 rad/s a step has ten frames and its stance may last for one; many steps together, sampled at different phases,
resolve the stance. The curve has kinks where the leg catches and lets go, so a global smoother is unsuitable. A local
cubic is fitted in windows of many centres and widths, and for each centre the widest window is kept whose residuals are
noise (Lepski's rule): such a window ends before a kink, and spans the whole step where the robot swims, so noise is not
mistaken for a peak.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats

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
_MAX_DRIFT = 0.01, 0.5
"""Drift of the film against the legs over a trial beyond which steps no longer fold onto one curve, in steps and in
frames: hardly an effect moves a step by so much, and aliasing moves it by less than half a frame."""
_MIN_STEPS, _MAX_SCATTER = 5, 0.05
"""Number of steps, and scatter of their phases in steps, from which a drift is told from chance."""
MIN_POINTS = 8
"""Smallest number of points in a window, so that a cubic has residuals."""
MIN_NOISE = 1e-7
"""Lower bound of the noise estimate."""


class NotMeasured(Exception):
    """The film does not determine a quantity; ``str(error)`` is the reason."""


@dataclass(frozen=True)
class Folded:
    """Samples of all steps by phase, ascending."""

    phase: Floats
    """(n,) in [0, 1)."""
    value: Floats
    """(n,)."""
    noise: float
    """Typical standard deviation of a value."""
    deviation: Floats
    """(n,) deviation of each value from its neighbours, scaled to the same standard deviation; includes differences
    between steps."""
    advance: float
    """Increase of the value over one step."""


@dataclass(frozen=True)
class _Fit:
    slope: float
    level: float
    slope_se: float
    level_se: float


def peak_slope(t_s: Floats, x_m: Floats, edges_s: Floats, rest_m: Floats) -> float:
    """Largest dx/dt of the folded step [m/s].

    ``rest_m``: position at each of the ``edges_s``. Raises NotMeasured.
    """
    number, x = _inside(t_s, x_m, edges_s)
    step = number.astype(int)
    lengths = np.diff(rest_m)
    length = lengths[step]
    # Of steps that were tracked to both their ends; there may be none.
    mean = float(np.nanmean(lengths)) if np.isfinite(lengths).any() else np.nan
    seconds = float(np.median(np.diff(edges_s)))
    # Differences in step length are removed in proportion, which leaves the shape at the mean length.
    part = (x - rest_m[step]) - (length - mean) * _progress(number % 1.0, x - rest_m[step], length)
    folded = fold(number % 1.0, part, mean)
    line = _featureless(folded, degree=1)
    if line is not None:
        return line.slope / seconds
    _check_in_step(number, part - mean * (number % 1.0))
    best = _best(folded, lambda fit: fit.slope - 5 * fit.slope_se, _MAX_GAP)
    secant = _steepest_secant(folded)
    if secant > _MAX_RATIO * best.slope:
        found = f"{best.slope / seconds:.4f} m/s where it moves at {secant / seconds:.4f} m/s at least"
        raise NotMeasured(f"an arc too short to resolve ({found})")
    return best.slope / seconds


def peak_height(t_s: Floats, z_m: Floats, edges_s: Floats) -> float:
    """Largest z of the folded step, median over the steps [m]; the plain mean if the folded curve is flat.

    Raises NotMeasured.
    """
    number, z = _inside(t_s, z_m, edges_s)
    folded = fold(number % 1.0, z, 0.0)
    flat = _featureless(folded, degree=0)
    if flat is not None:
        return flat.level
    _check_in_step(number, z)
    top = _best(folded, lambda fit: fit.level - 5 * fit.level_se).level
    highest = _highest_group(folded)
    if highest > _MAX_RATIO * max(top, _FLAT_M):
        raise NotMeasured(f"a top too short to resolve ({top:.5f} m where it is at {highest:.5f} m at least)")
    return top * _median_scale(number, z, folded)


def fold(phase: Floats, value: Floats, advance: float) -> Folded:
    """Sort by phase and estimate the noise from each point's distance to the line through its neighbours.

    Raises NotMeasured.
    """
    seen = np.isfinite(value)
    check_enough(int(seen.sum()))
    order = np.argsort(phase[seen], kind="stable")
    phase, value = phase[seen][order], value[seen][order]
    left, middle, right = phase[:-2], phase[1:-1], phase[2:]
    share = np.divide(middle - left, right - left, out=np.full(middle.size, 0.5), where=right > left)
    deviation = value[1:-1] - (value[:-2] * (1 - share) + value[2:] * share)
    deviation = deviation / np.sqrt(1 + share**2 + (1 - share) ** 2)
    deviation = np.concatenate((deviation[:1], deviation, deviation[-1:]))
    return Folded(phase, value, _spread(deviation), deviation, advance)


def check_enough(frames: int) -> None:
    """Raise NotMeasured if so few frames in steady steps give neither lift nor peak speed."""
    if frames < 4 * MIN_POINTS:
        raise NotMeasured(f"{frames} frames in steady steps, at least {4 * MIN_POINTS} are needed")


def _check_in_step(number: Floats, part: Floats) -> None:
    """Raise NotMeasured if the film's steps last longer or shorter than those of the legs.

    The first harmonic of each step's ``part``, which is 0 at both its ends, gives its phase; a drift of the phases is
    an error of the camera's clock against the legs' (or of an ω that was only assumed).
    """
    seen = np.isfinite(part)
    step, phase, part = number[seen].astype(int), number[seen] % 1.0, part[seen]
    steps, frames = np.unique(step, return_counts=True)
    if steps.size < _MIN_STEPS:
        return
    harmonic = np.array([_first_harmonic(phase[step == one], part[step == one]) for one in steps])
    late = -np.unwrap(np.angle(harmonic)) / (2 * np.pi)
    rate, offset = np.polyfit(steps, late, 1)
    scatter = float(np.sqrt(np.sum((late - rate * steps - offset) ** 2) / (steps.size - 2)))
    se = scatter / float(np.std(steps) * np.sqrt(steps.size))
    drift = abs(rate) * float(np.ptp(steps))
    allowed = max(_MAX_DRIFT[0], _MAX_DRIFT[1] / float(np.median(frames)))
    if scatter < _MAX_SCATTER and drift > allowed and abs(rate) > 5 * se:
        longer = f"{100 * abs(rate):.2f} ± {100 * se:.1g} % {'longer' if rate > 0 else 'shorter'}"
        raise NotMeasured(
            f"the film's steps last {longer} than the legs', {drift:.2f} of a step in all: is the camera's clock right?"
        )


def _first_harmonic(phase: Floats, part: Floats) -> complex:
    phase, part = np.concatenate(([0.0], phase, [1.0])), np.concatenate(([0.0], part, [0.0]))
    return complex(np.trapezoid(part * np.exp(-2j * np.pi * phase), phase))


def _grouped(values: Floats, size: int) -> Floats:
    """Neighbours side by side, (n // size, size); an incomplete last group is left out."""
    groups = values.size // size
    return values[: groups * size].reshape(groups, size)


def _spread(deviation: Floats) -> float:
    return max(1.4826 * float(np.median(np.abs(deviation))), MIN_NOISE)


def _inside(t_s: Floats, value: Floats, edges_s: Floats) -> tuple[Floats, Floats]:
    """Step number with phase as its fraction, and value, of the frames within the edges."""
    if edges_s.size < 2:
        raise NotMeasured("no whole steady step")
    number = np.interp(t_s, edges_s, np.arange(edges_s.size), left=np.nan, right=np.nan)
    keep = np.isfinite(number) & (number < edges_s.size - 1)
    return number[keep], value[keep]


def _progress(phase: Floats, part: Floats, length: Floats) -> Floats:
    """Fraction of the step's length covered at each phase: the folded median of x/length."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(length > 1e-3, part / length, phase)
    seen = np.isfinite(ratio)
    if seen.sum() < 10:
        return phase
    order = np.argsort(phase[seen])
    p, r = phase[seen][order], np.clip(ratio[seen][order], -0.5, 1.5)
    size = max(1, p.size // 40)
    middle, level = (np.median(_grouped(values, size), axis=1) for values in (p, r))
    knots, levels = np.concatenate(([0.0], middle, [1.0])), np.concatenate(([0.0], level, [1.0]))
    return np.asarray(np.interp(phase, knots, levels), dtype=float)


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
    phase, value, deviation = (_grouped(array, _GROUP) for array in (folded.phase, folded.value, folded.deviation))
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
    middle, level = (_grouped(values, size).mean(axis=1) for values in (folded.phase, folded.value))
    return np.asarray(np.interp(phase, middle, level, period=1.0), dtype=float)
