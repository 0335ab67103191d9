"""Velocity from positions afterwards: a Rauch–Tung–Striebel smoother with the most likely of a few models (for real
time: speed.py).

White noise integrated two to four times describes any motion; a mean with slowly varying harmonics of one frequency
describes steady gait. The model, its noise and its frequency are chosen by maximum likelihood, without leg angles.

Positions [m], times [s], velocities [m/s]. A missing position is NaN and so is its velocity: nothing is interpolated.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from math import factorial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from sandbot_common.arrays import Floats
from sandbot_common.compiled import compiled
from sandbot_common.errors import InputError
from sandbot_tracking.speed import HARMONICS, harmonic_model

MISFIT = 4.0
"""Ratio of residual variances, with over without harmonics, from which the harmonic model is rejected."""
_DIFFUSE = 1e10
"""Initial variance of an unknown state, in units of a position's variance."""


@dataclass(frozen=True)
class Velocity:
    """Velocity of each sample."""

    v: Floats
    """[m/s], (n,); NaN where the position was missing."""
    var: Floats
    """[m²/s²], (n,); NaN likewise."""
    gaps: int
    """Number of missing positions."""


def smooth(t_s: ArrayLike, x_m: ArrayLike) -> Velocity:
    """Velocity of a whole record, (n,), from positions with a common variance, which is estimated.

    Raises InputError if times do not increase or there are fewer than 8 positions.
    """
    t, x = np.asarray(t_s, dtype=float), np.asarray(x_m, dtype=float)
    if t.ndim != 1 or x.shape != t.shape:
        raise InputError(f"shapes of time {t.shape} and position {x.shape} must be one (n,)")
    if not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise InputError("times must be finite and grow")
    seen = np.isfinite(x)
    if seen.sum() < 8:
        raise InputError(f"{int(seen.sum())} positions: at least 8 are needed for a velocity")
    r = np.where(seen, 1.0, np.nan)
    y = np.where(seen, x - x[seen][0], np.nan)
    v, v_var, _, scale = _rts(y, r, *_best_model(t, y, r))
    return Velocity(np.where(seen, v, np.nan), np.where(seen, v_var * scale, np.nan), int((~seen).sum()))


class _Model(NamedTuple):
    """A linear model with k states, the first of which is x; variances relative to that of a position."""

    transition: Floats
    """(n, k, k), to each sample from the one before."""
    noise: Floats
    """(n, k, k)."""
    start: Floats
    """(k,) variances at the first sample."""
    velocity: Floats
    """(k,): v is this times the state."""


_Scored = tuple[float, _Model]
"""Negative log-likelihood, and the model."""


def _best_model(t: Floats, y: Floats, r: Floats) -> _Model:
    """The most likely model; a periodic one is rejected if its residuals exceed the position noise."""
    cost, usual = min(_integrated(t, y, r), key=lambda scored: scored[0])
    noise = _rts(y, r, *usual)[3]
    periodic = [scored for scored in _periodic(t, y, r) if _rts(y, r, *scored[1])[3] < MISFIT * noise]
    return min(((cost, usual), *periodic), key=lambda scored: scored[0])[1]


def _integrated(t: Floats, y: Floats, r: Floats) -> Iterator[_Scored]:
    """White noise integrated two to four times, each at its most likely strength."""
    for order in (2, 3, 4):
        yield _fitted(y, r, partial(_integrated_noise, t, order), np.arange(-9.0, 4.0))


def _periodic(t: Floats, y: Floats, r: Floats) -> Iterator[_Scored]:
    """A mean and slowly varying harmonics of one frequency, each at its most likely value; equidistant frames only."""
    frame = float(np.median(np.diff(t)))
    if not np.allclose(np.diff(t), frame, rtol=1e-3):
        return
    for first in _frequencies(y, frame):
        ratios = np.arange(-6.0, 7.0, 2.0)
        log_ratio = _best_ratio(y, r, partial(_harmonics, t.size, frame, first), ratios)[1]

        def cost(base: float, log_ratio: float = log_ratio) -> float:
            return _negative_log_likelihood(y, r, _harmonics(t.size, frame, base, 10.0**log_ratio))

        # A spectral line is located to a fraction of its width, 2π over the length of the record.
        width = np.pi / (t.size * frame)
        near = (first - width, first + width)
        base = float(minimize_scalar(cost, bounds=near, method="bounded", options={"xatol": width / 50}).x)
        yield _fitted(y, r, partial(_harmonics, t.size, frame, base), ratios)


def _fitted(y: Floats, r: Floats, model: Callable[[float], _Model], scan: Floats) -> _Scored:
    """The model at its most likely noise ratio."""
    cost, log_ratio = _best_ratio(y, r, model, scan)
    return cost, model(10.0**log_ratio)


def _best_ratio(y: Floats, r: Floats, model: Callable[[float], _Model], scan: Floats) -> tuple[float, float]:
    """Negative log-likelihood and log10 of the most likely ratio. There may be two local minima (smooth motion with
    noise, rough motion without): the coarse values of ``scan`` select one."""

    def cost(log_ratio: float) -> float:
        return _negative_log_likelihood(y, r, model(10.0**log_ratio))

    start, step = scan[int(np.argmin([cost(value) for value in scan]))], scan[1] - scan[0]
    found = minimize_scalar(cost, bounds=(start - step, start + step), method="bounded", options={"xatol": 0.02})
    return float(found.fun), float(found.x)


def _negative_log_likelihood(y: Floats, r: Floats, model: _Model) -> float:
    return -float(_rts(y, r, *model)[2])


def _frequencies(y: Floats, frame: float) -> list[float]:
    """The strongest line of the speed's spectrum and half of it [rad/s], as left and right steps may differ."""
    seen = np.isfinite(y)
    v = np.diff(np.interp(np.arange(y.size), np.flatnonzero(seen), y[seen]))
    size = 8 * v.size
    power = np.abs(np.fft.rfft((v - v.mean()) * np.hanning(v.size), size))
    # Fewer than three periods in the record do not define a frequency.
    power[: 3 * 8] = 0.0
    line = 2 * np.pi * float(np.argmax(power)) / (size * frame)
    return [line, line / 2] if line > 0 else []


def _harmonics(n: int, frame: float, base_rad_s: float, ratio: float) -> _Model:
    transition, noise = harmonic_model(HARMONICS, base_rad_s, frame)
    velocity = np.array([0.0, 1.0, *(1.0, 0.0) * HARMONICS])
    start = np.full(len(transition), _DIFFUSE / frame**2)
    start[0] = _DIFFUSE
    # Scaled such that for a ratio of 1 the process noise of x per frame is of the order of a position's noise.
    noise = noise * ratio / frame**3
    return _Model(np.tile(transition, (n, 1, 1)), np.tile(noise, (n, 1, 1)), start, velocity)


def _integrated_noise(t: Floats, order: int, ratio: float) -> _Model:
    """Transitions and process noise (n, order, order) of dⁿx/dtⁿ = white noise, before each sample."""
    frame = float(np.median(np.diff(t)))
    step = np.diff(t, prepend=t[0] - frame) / frame
    power = np.subtract.outer(np.arange(order), np.arange(order)).T
    exact = np.array([[1 / factorial(p) if p >= 0 else 0.0 for p in row] for row in power])
    transition = exact * step[:, None, None] ** np.maximum(power, 0)
    i = order - 1 - np.arange(order)
    weight = np.array([[1 / (factorial(a) * factorial(b) * (a + b + 1)) for b in i] for a in i])
    noise = ratio * weight * step[:, None, None] ** (i[:, None] + i[None, :] + 1)
    # Converts the state (x, x', x'' …) from derivatives per frame to derivatives per second.
    noise = _per_second(noise, frame, both=True)
    # Diffuse initial state, relative to the process noise of each derivative.
    start = 1e6 * np.diag(noise[0]) * 2.0
    start[0] = 1e6 * (noise[0, 0, 0] + 1.0)
    return _Model(_per_second(transition, frame), noise, start, np.eye(order)[1])


def _per_second(matrix: Floats, frame: float, both: bool = False) -> Floats:
    scale = frame ** -np.arange(matrix.shape[-1], dtype=float)
    return matrix * scale[:, None] * (scale[None, :] if both else 1 / scale[None, :])


@compiled
def _rts(y, r, transition, noise, start, velocity):  # type: ignore[no-untyped-def]
    """Velocity, its variance (in units of the scale), concentrated log-likelihood, and the scale of all variances."""
    n, k = transition.shape[0], transition.shape[1]
    mean, cov = np.zeros(k), np.diag(start)
    means, covs = np.empty((n, k)), np.empty((n, k, k))
    predicted, spread = np.empty((n, k)), np.empty((n, k, k))
    squares, logs, count = 0.0, 0.0, 0
    for j in range(n):
        if j > 0:
            mean = transition[j] @ mean
            cov = transition[j] @ cov @ transition[j].T + noise[j]
        predicted[j], spread[j] = mean, cov
        if not np.isnan(y[j]):
            total = cov[0, 0] + r[j]
            gain = cov[:, 0] / total
            error = y[j] - mean[0]
            if j >= k:
                squares, logs, count = squares + error * error / total, logs + np.log(total), count + 1
            mean = mean + gain * error
            rest = np.eye(k)
            rest[:, 0] -= gain
            cov = rest @ cov @ rest.T + r[j] * np.outer(gain, gain)
        means[j], covs[j] = mean, cov
    scale = squares / max(count, 1)
    v, v_var = np.empty(n), np.empty(n)
    v[n - 1], v_var[n - 1] = velocity @ means[n - 1], velocity @ covs[n - 1] @ velocity
    late, late_cov = means[n - 1].copy(), covs[n - 1].copy()
    for j in range(n - 2, -1, -1):
        back = np.linalg.solve(spread[j + 1], transition[j + 1] @ covs[j]).T
        late = means[j] + back @ (late - predicted[j + 1])
        late_cov = covs[j] + back @ (late_cov - spread[j + 1]) @ back.T
        v[j], v_var[j] = velocity @ late, max(velocity @ late_cov @ velocity, 0.0)
    return v, v_var, -0.5 * (count * np.log(max(scale, 1e-30)) + logs), scale
