"""Which trials would tell the surviving sets apart (T-optimality: Atkinson & Fedorov 1975)."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from sandbot_model.cells import OBSERVABLES
from sandbot_model.chain import Array
from sandbot_model.fit import Fit

MOST = 6
FINER = 3
"""Frequencies tried between neighbouring ones."""
SETTLED_SD = 5.0
"""Gap in standard errors at which a pair of sets counts as told apart."""


@dataclass(frozen=True)
class NextTrial:
    """A trial worth running: the two sets it separates and by how many standard deviations of one replicate."""

    phi: float
    omega_rad_s: float
    observable: str
    separates: tuple[str, str]
    expected_gap_sd: float
    replicates: int


def next_trials(contenders: Sequence[Fit]) -> list[NextTrial]:
    """At least three trials (if there are two contenders), the most telling first, no two at one condition."""
    found: list[NextTrial] = []
    for one, other in combinations(contenders[:4], 2):
        found += _best_of_pair(one, other)
    found.sort(key=lambda trial: -trial.expected_gap_sd)
    chosen: list[NextTrial] = []
    for trial in found:
        if all((trial.phi, trial.omega_rad_s) != (t.phi, t.omega_rad_s) for t in chosen):
            chosen.append(trial)
    return chosen[:MOST]


def _best_of_pair(one: Fit, other: Fit) -> list[NextTrial]:
    cells = one.cells
    omega = _finer(np.unique(np.round(cells.omega, 3)))
    phi = cells.level_phi
    first, second = (fit.predict(phi[:, None], omega[None, :]).observables for fit in (one, other))
    noise = np.where(np.isfinite(cells.noise), cells.noise, np.inf)
    gap = np.abs(first - second) / np.sqrt(
        noise**2 + _edge_variance(one, phi, omega) + _edge_variance(other, phi, omega)
    )
    separates = (" + ".join(one.effects) or "base", " + ".join(other.effects) or "base")
    trials = []
    for flat in np.argsort(-gap, axis=None)[: 4 * MOST]:
        p, w, o = np.unravel_index(flat, gap.shape)
        size = float(gap[p, w, o])
        if size > 0:
            replicates = max(2, int(np.ceil((SETTLED_SD / size) ** 2)))
            trials.append(NextTrial(float(phi[p]), float(omega[w]), OBSERVABLES[o], separates, size, replicates))
    return trials


def _edge_variance(fit: Fit, phi: Array, omega: Array) -> Array:
    """Variance of a prediction that comes from not knowing k and the bed's φ, ``(levels, frequencies, 4)``."""
    error = np.hypot(np.nan_to_num(fit.k_stderr_n_per_m), fit.state.slope[0] * fit.cells.phi_scatter)
    sides = []
    for sign in (-1.0, 1.0):
        moved = np.interp(phi, fit.level_phi, fit.level_phi) + sign * error / np.maximum(fit.state.slope[0], 1e-9)
        sides.append(fit.predict(moved[:, None], omega[None, :]).observables)
    return np.asarray((0.5 * (sides[1] - sides[0])) ** 2)


def _finer(omega: Array) -> Array:
    if len(omega) < 2:
        return omega
    steps = [np.linspace(a, b, FINER + 1, endpoint=False) for a, b in pairwise(omega)]
    return np.round(np.concatenate([*steps, omega[-1:]]), 2)
