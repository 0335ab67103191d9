"""All steps folded onto one phase axis, so that many frames of many steps show one step finely sampled.

At ω = 30 rad/s a step has ten frames and its stance may last for one; many steps together, sampled at different phases,
resolve the stance.
"""

from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats

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


def fold(phase: Floats, value: Floats, advance: float) -> Folded:
    """Samples of ``phase`` and ``value (n,)`` sorted by phase; the noise is estimated from each one's distance to the
    line through its neighbours. ``advance``: increase of the value over one step.

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


def check_in_step(number: Floats, part: Floats) -> None:
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


def inside(t_s: Floats, value: Floats, edges_s: Floats) -> tuple[Floats, Floats]:
    """Step number with phase as its fraction, and value, of the frames ``t_s``, ``value (n,)`` within the edges."""
    if edges_s.size < 2:
        raise NotMeasured("no whole steady step")
    number = np.interp(t_s, edges_s, np.arange(edges_s.size), left=np.nan, right=np.nan)
    keep = np.isfinite(number) & (number < edges_s.size - 1)
    return number[keep], value[keep]


def progress(phase: Floats, part: Floats, length: Floats) -> Floats:
    """Fraction ``(n,)`` of the step's length covered at each phase ``(n,)``: the folded median of x/length."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(length > 1e-3, part / length, phase)
    seen = np.isfinite(ratio)
    if seen.sum() < 10:
        return phase
    order = np.argsort(phase[seen])
    p, r = phase[seen][order], np.clip(ratio[seen][order], -0.5, 1.5)
    size = max(1, p.size // 40)
    middle, level = (np.median(grouped(values, size), axis=1) for values in (p, r))
    knots, levels = np.concatenate(([0.0], middle, [1.0])), np.concatenate(([0.0], level, [1.0]))
    return np.asarray(np.interp(phase, knots, levels), dtype=float)


def grouped(values: Floats, size: int) -> Floats:
    """Neighbours side by side, (n // size, size); an incomplete last group is left out."""
    groups = values.size // size
    return values[: groups * size].reshape(groups, size)


def _spread(deviation: Floats) -> float:
    return max(1.4826 * float(np.median(np.abs(deviation))), MIN_NOISE)
