"""Velocity from positions in real time, without lag: v = mean + 3 harmonics of the known step frequency (for whole
records: smooth.py).

A single filter cannot both average over steady gait and respond quickly when walking turns into swimming; a bank of
interacting filters with small to large process noise (interacting multiple model, Blom & Bar-Shalom 1988, IEEE Trans.
Autom. Control 33, 780) can, and its variance reflects which of them currently dominates.

Positions [m], times [s], velocities [m/s]. A missing position is NaN and so is its velocity: nothing is interpolated.
"""

from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from sandbot_common.arrays import Floats
from sandbot_common.compiled import compiled
from sandbot_common.errors import InputError

HARMONICS = 3
BASE = 2
"""Fundamental in units of ω: tripods half a period apart take a step each half period."""
BANK = np.array([2e-7, 2e-6, 2e-6, 1e-3, 1.0])
"""Random-walk intensity of mean and harmonics in each filter of the bank [(m/s)²/s]."""
MISFIT_M2 = np.array([0.0, 2e-4**2, 1e-3**2, 0.0, 0.0])
"""Variance of position that each filter leaves unexplained: the motion of a leg that catches and lets go has more than
3 harmonics."""
STAY = 0.999
"""Probability per frame that the active filter does not change."""
_START_V, _START_H = 0.3**2, 0.2**2


class HarmonicSpeed:
    """Current velocity from the positions so far and the leg frequency."""

    def __init__(self) -> None:
        self.gaps = 0
        size = 2 + 2 * HARMONICS
        self._t_s: float | None = None
        self._clock: float | None = None
        self._means = np.zeros((BANK.size, size))
        self._covs = np.zeros((BANK.size, size, size))
        self._weights = np.full(BANK.size, 1 / BANK.size)

    def update(self, t_s: float, x_m: float, var_m2: float, omega_rad_s: float | None = None) -> tuple[float, float]:
        """(v, variance) at ``t_s`` after a position with its variance; NaN if the position is NaN.

        ``omega_rad_s``: current leg frequency; None while the legs stand still or if it is unknown. Raises InputError
        if time does not increase.
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
        transition, noise = harmonic_model(HARMONICS, 0.0 if clock is None else clock * BASE, dt)
        self._t_s = t_s
        v, var = _imm(
            self._means,
            self._covs,
            self._weights,
            transition,
            noise,
            float(x_m) if seen else np.nan,
            float(var_m2) if seen else 1.0,
            (HARMONICS + 1.0) * BASE * (clock or 0.0),
        )
        return (float(v), float(var)) if seen else (np.nan, np.nan)

    def _begin(self, t_s: float, x_m: float, var_m2: float) -> None:
        self._t_s = t_s
        self._means[:, 0] = x_m
        self._covs[:] = np.diag([var_m2, _START_V, *(_START_H,) * (2 * HARMONICS)])

    def _forget_harmonics(self) -> None:
        self._means[:, 2:] = 0.0
        self._covs[:, 2:, :] = 0.0
        self._covs[:, :, 2:] = 0.0
        for i in range(2, self._means.shape[1]):
            self._covs[:, i, i] = _START_H


@lru_cache(maxsize=256)
def harmonic_model(harmonics: int, base_rad_s: float, dt: float) -> tuple[Floats, Floats]:
    """Transition matrix and process noise over ``dt`` for a random-walk intensity of 1.

    State: x, mean, then (c, s) for each harmonic, with v = mean + Σ c and (c, s) rotating at its frequency; harmonics
    near or above the Nyquist frequency are left out. Noise by Van Loan's method.
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


@compiled
def _imm(means, covs, weights, transition, noise, x, r, beyond_rad_s):  # type: ignore[no-untyped-def]
    """One step of the bank (interacting multiple model), in place; returns mean and variance of v over the bank.

    ``means (models, states)``, ``covs (models, states, states)``, ``weights (models,)``. ``x``, ``r``: position [m],
    NaN if not seen, and its variance. ``beyond_rad_s``: frequency of the first harmonic left out, by which the
    unexplained position is converted to speed.
    """
    prior = _mix(means, covs, weights)
    likelihood = np.zeros(len(means))
    for j in range(len(means)):
        mean, cov = transition @ means[j], transition @ covs[j] @ transition.T + BANK[j] * noise
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
    return _speed(means, covs, weights, beyond_rad_s)


@compiled
def _mix(means, covs, weights):  # type: ignore[no-untyped-def]
    """Start each model from the mixture of all that may have turned into it, in place; returns their prior weights."""
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
            difference = means[i] - mixed_means[j]
            mixed_covs[j] += share[i] * (covs[i] + np.outer(difference, difference))
    means[:], covs[:] = mixed_means, mixed_covs
    return prior


@compiled
def _speed(means, covs, weights, beyond_rad_s):  # type: ignore[no-untyped-def]
    """Mean and variance of v = mean + Σ c over the bank."""
    m, k = means.shape
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
