"""Positions to velocity: a smoother for afterwards, a clock-locked filter for now.

``smooth``         offline: Rauch–Tung–Striebel on an integrated-noise model, its order and noise by maximum likelihood.
``HarmonicSpeed``  online, no lag: v = mean + 3 harmonics of the known step frequency. One filter cannot be both calm
                   on steady gait and quick where walking turns into swimming; an interacting bank of filters with
                   process noise from calm to wild (Blom & Bar-Shalom 1988) is, and says by its variance which it
                   just was.

Positions [m], times [s], velocities [m/s]. A missing position is NaN and so is its velocity: nothing is interpolated.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import factorial

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

from sandbot_common.errors import InputError

Floats = NDArray[np.float64]

HARMONICS = 3
BANK = np.array([2e-7, 2e-6, 2e-6, 1e-3, 1.0])
"""Random walk of mean and harmonics of each filter of the bank [(m/s)²/s]."""
MISFIT_M2 = np.array([0.0, 2e-4**2, 1e-3**2, 0.0, 0.0])
"""Variance of the position each filter leaves unexplained: a leg that catches and lets go has more than 3 harmonics."""
STAY = 0.999
"""Probability that the filter which is right stays right for a frame."""
_START_V, _START_H = 0.3**2, 0.2**2


@dataclass(frozen=True)
class Velocity:
    """Velocity of each sample."""

    v: Floats
    """[m/s], (n,); NaN where the position was missing."""
    var: Floats
    """[m²/s²], (n,); NaN likewise."""
    gaps: int
    """How many are missing."""


def smooth(t_s: ArrayLike, x_m: ArrayLike, var: ArrayLike | None = None) -> Velocity:
    """Velocity of a whole record, (n,), from positions with relative variances ``var`` (their scale is estimated).

    The model: the ``order``-th derivative of x is white noise, order 2 to 4 by likelihood. Raises InputError on times
    that do not grow, or fewer than 8 positions.
    """
    t, x = np.asarray(t_s, dtype=float), np.asarray(x_m, dtype=float)
    r = np.ones_like(x) if var is None else np.asarray(var, dtype=float)
    if t.ndim != 1 or x.shape != t.shape or r.shape != t.shape:
        raise InputError(f"shapes of time {t.shape}, position {x.shape} and variance {r.shape} must be one (n,)")
    if not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise InputError("times must be finite and grow")
    seen = np.isfinite(x) & np.isfinite(r) & (r > 0)
    if seen.sum() < 8:
        raise InputError(f"{int(seen.sum())} positions: at least 8 are needed for a velocity")
    r = np.where(seen, r / np.median(r[seen]), np.nan)
    y = np.where(seen, x - x[seen][0], np.nan)
    order, ratio = _most_likely(t, y, r)
    transition, noise = _integrated_noise(t, order, ratio)
    v, v_var, _, scale = _rts(y, r, transition, noise)
    return Velocity(np.where(seen, v, np.nan), np.where(seen, v_var * scale, np.nan), int((~seen).sum()))


def _most_likely(t: Floats, y: Floats, r: Floats) -> tuple[int, float]:
    """Order of the model and its noise ratio q/r; in units of one frame, so that a ratio of 1 is even."""
    best: tuple[float, int, float] | None = None
    for order in (2, 3, 4):

        def cost(log_ratio: float, order: int = order) -> float:
            transition, noise = _integrated_noise(t, order, 10.0**log_ratio)
            return -float(_rts(y, r, transition, noise)[2])

        # Two basins are possible (calm with noise, wild without): a coarse scan chooses one.
        scan = np.arange(-9.0, 4.0, 1.0)
        start = scan[int(np.argmin([cost(value) for value in scan]))]
        found = minimize_scalar(cost, bounds=(start - 1, start + 1), method="bounded", options={"xatol": 0.02})
        if best is None or found.fun < best[0]:
            best = (float(found.fun), order, 10.0 ** float(found.x))
    assert best is not None
    return best[1], best[2]


def _integrated_noise(t: Floats, order: int, ratio: float) -> tuple[Floats, Floats]:
    """Transitions and process noise (n, order, order) of dⁿx/dtⁿ = white noise, before each sample."""
    frame = float(np.median(np.diff(t)))
    step = np.diff(t, prepend=t[0] - frame) / frame
    power = np.subtract.outer(np.arange(order), np.arange(order)).T
    exact = np.array([[1 / factorial(p) if p >= 0 else 0.0 for p in row] for row in power])
    transition = exact * step[:, None, None] ** np.maximum(power, 0)
    i = order - 1 - np.arange(order)
    weight = np.array([[1 / (factorial(a) * factorial(b) * (a + b + 1)) for b in i] for a in i])
    noise = ratio * weight * step[:, None, None] ** (i[:, None] + i[None, :] + 1)
    # The state is (x, x', x'' …) per frame; velocity per second is what callers get.
    return _per_second(transition, frame), _per_second(noise, frame, both=True)


def _per_second(matrix: Floats, frame: float, both: bool = False) -> Floats:
    scale = frame ** -np.arange(matrix.shape[-1], dtype=float)
    return matrix * scale[:, None] * (scale[None, :] if both else 1 / scale[None, :])


@numba.njit(cache=True)
def _rts(y, r, transition, noise):  # type: ignore[no-untyped-def]
    """Velocity, its variance (in units of the scale), concentrated log-likelihood, scale of all variances."""
    n, k = transition.shape[0], transition.shape[1]
    mean, cov = np.zeros(k), np.eye(k)
    for i in range(k):
        # Diffuse to begin with, relative to the process noise in each derivative.
        cov[i, i] = 1e6 * (noise[0, i, i] + (1.0 if i == 0 else noise[0, i, i]))
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
    v[n - 1], v_var[n - 1] = means[n - 1, 1], covs[n - 1, 1, 1]
    late, late_cov = means[n - 1].copy(), covs[n - 1].copy()
    for j in range(n - 2, -1, -1):
        back = np.linalg.solve(spread[j + 1], transition[j + 1] @ covs[j]).T
        late = means[j] + back @ (late - predicted[j + 1])
        late_cov = covs[j] + back @ (late_cov - spread[j + 1]) @ back.T
        v[j], v_var[j] = late[1], max(late_cov[1, 1], 0.0)
    return v, v_var, -0.5 * (count * np.log(max(scale, 1e-30)) + logs), scale


class HarmonicSpeed:
    """Velocity now, from positions so far and the clock frequency.

    ``base``: fundamental of the harmonics in units of ω: 2 for tripods half a period apart (a step each half period), 1
    if left and right steps differ. ``harmonics`` above Nyquist are left out.
    """

    def __init__(self, harmonics: int = HARMONICS, base: int = 2) -> None:
        if not 0 <= harmonics <= 20 or base not in (1, 2):
            raise InputError(f"harmonics {harmonics} (0 to 20), base {base} (1 or 2)")
        self.gaps = 0
        self._base, size = base, 2 + 2 * harmonics
        self._harmonics = harmonics
        self._t_s: float | None = None
        self._clock: float | None = None
        self._means = np.zeros((BANK.size, size))
        self._covs = np.zeros((BANK.size, size, size))
        self._weights = np.full(BANK.size, 1 / BANK.size)

    def update(self, t_s: float, x_m: float, var_m2: float, omega_rad_s: float | None = None) -> tuple[float, float]:
        """(v, variance) at ``t_s`` after a position with its variance; NaN if the position is NaN.

        ``omega_rad_s``: leg frequency now; None while the legs stand still or it is unknown. Raises InputError if time
        does not grow.
        """
        seen = bool(np.isfinite(x_m) and np.isfinite(var_m2) and var_m2 > 0)
        self.gaps += not seen
        if self._t_s is None:
            if seen:
                self._begin(t_s, x_m, var_m2)
            return (0.0, _START_V) if seen else (np.nan, np.nan)
        if not t_s > self._t_s:
            raise InputError(f"time {t_s} s does not come after {self._t_s} s")
        clock = None if omega_rad_s is None or omega_rad_s < 0.1 else round(float(omega_rad_s), 3)
        if (clock is None) != (self._clock is None):
            self._forget_harmonics()
        self._clock = clock
        dt = round(t_s - self._t_s, 9)
        transition, noise = _harmonic_model(self._harmonics, 0.0 if clock is None else clock * self._base, dt)
        self._t_s = t_s
        v, var = _imm(
            self._means,
            self._covs,
            self._weights,
            transition,
            noise,
            float(x_m) if seen else np.nan,
            float(var_m2) if seen else 1.0,
            (self._harmonics + 1.0) * self._base * (clock or 0.0),
        )
        return (float(v), float(var)) if seen else (np.nan, np.nan)

    def _begin(self, t_s: float, x_m: float, var_m2: float) -> None:
        self._t_s = t_s
        self._means[:, 0] = x_m
        self._covs[:] = np.diag([var_m2, _START_V, *(_START_H,) * (2 * self._harmonics)])

    def _forget_harmonics(self) -> None:
        self._means[:, 2:] = 0.0
        self._covs[:, 2:, :] = 0.0
        self._covs[:, :, 2:] = 0.0
        for i in range(2, self._means.shape[1]):
            self._covs[:, i, i] = _START_H


@lru_cache(maxsize=256)
def _harmonic_model(harmonics: int, base_rad_s: float, dt: float) -> tuple[Floats, Floats]:
    """Transition and process noise per unit of the bank, over ``dt``.

    State: x, mean, then for each harmonic (c, s) with v = mean + Σ c and (c, s) turning at its frequency. Noise by
    Van Loan.
    """
    size = 2 + 2 * harmonics
    drift, source = np.zeros((size, size)), np.zeros((size, size))
    drift[0, 1], source[1, 1] = 1.0, 1.0
    for k in range(1, harmonics + 1):
        c, frequency = 2 * k, k * base_rad_s
        if 0.0 < frequency < 0.9 * np.pi / dt:
            drift[0, c], drift[c, c + 1], drift[c + 1, c] = 1.0, frequency, -frequency
            source[c, c] = source[c + 1, c + 1] = 1.0
    block = expm(np.block([[-drift, source], [np.zeros_like(drift), drift.T]]) * dt)
    transition = block[size:, size:].T
    return np.ascontiguousarray(transition), np.ascontiguousarray(transition @ block[:size, size:])


@numba.njit(cache=True)
def _imm(means, covs, weights, transition, noise, x, r, beyond_rad_s):  # type: ignore[no-untyped-def]
    """One step of the bank in place; mean and variance of v over the bank.

    ``beyond_rad_s``: the first harmonic left out; what is unexplained of x moves about as fast as that.
    """
    m, k = means.shape
    swap = (1.0 - STAY) / (m - 1)
    mixed_means, mixed_covs, prior = np.zeros((m, k)), np.zeros((m, k, k)), np.empty(m)
    for j in range(m):
        share = weights * swap
        share[j] = weights[j] * STAY
        prior[j] = share.sum()
        share = share / prior[j]
        for i in range(m):
            mixed_means[j] += share[i] * means[i]
        for i in range(m):
            off = means[i] - mixed_means[j]
            mixed_covs[j] += share[i] * (covs[i] + np.outer(off, off))
    likelihood = np.zeros(m)
    for j in range(m):
        mean = transition @ mixed_means[j]
        cov = transition @ mixed_covs[j] @ transition.T + BANK[j] * noise
        if not np.isnan(x):
            total = cov[0, 0] + r + MISFIT_M2[j]
            gain = cov[:, 0] / total
            error = x - mean[0]
            likelihood[j] = -0.5 * (error * error / total + np.log(total))
            mean = mean + gain * error
            cov = cov - np.outer(gain, gain) * total
        means[j], covs[j] = mean, 0.5 * (cov + cov.T)
    weights[:] = prior * np.exp(likelihood - likelihood.max()) + 1e-12
    weights /= weights.sum()
    v, var = 0.0, 0.0
    speeds, spreads = np.empty(m), np.empty(m)
    for j in range(m):
        speeds[j], spreads[j] = means[j, 1], covs[j, 1, 1] + MISFIT_M2[j] * beyond_rad_s**2
        for a in range(2, k, 2):
            speeds[j] += means[j, a]
            spreads[j] += 2.0 * covs[j, 1, a]
            for b in range(2, k, 2):
                spreads[j] += covs[j, a, b]
        v += weights[j] * speeds[j]
    for j in range(m):
        var += weights[j] * (spreads[j] + (speeds[j] - v) ** 2)
    return v, max(var, 0.0)
