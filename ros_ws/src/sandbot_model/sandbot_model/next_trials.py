"""Which trials would tell the surviving sets apart (T-optimality: Atkinson & Fedorov 1975)."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from sandbot_model.cells import OBSERVABLES, USUAL_NOISE
from sandbot_model.chain import Array
from sandbot_model.fit import Fit
from sandbot_model.penetration import USUAL_SD

MOST = 6
LEAST_SD = 0.3
"""Expected gap below which a measurement is not proposed: it would take hundreds."""
FINER = 3
"""Frequencies tried between neighbouring ones."""
PENETRATION = "penetration_force"
"""The force on a leg pressed into the ground: no trial, but a measurement that tells what trials can't."""
DEPTHS_M = (0.01, 0.02, 0.03, 0.044)
"""Depths at which it is proposed."""
SETTLED_SD = 5.0
"""Gap in standard errors at which a pair of sets counts as told apart."""


@dataclass(frozen=True)
class NextTrial:
    """A measurement worth making: the two sets it separates and by how many standard deviations of one replicate.

    ``observable`` is one of ``cells.OBSERVABLES``, of a trial at ``omega_rad_s``, or ``PENETRATION``, at ``depth_m``.
    """

    phi: float
    omega_rad_s: float
    observable: str
    separates: tuple[str, str]
    expected_gap_sd: float
    replicates: int
    depth_m: float = float("nan")

    @property
    def condition(self) -> tuple[float, ...]:
        """What has to be set up for it."""
        return (self.phi, self.depth_m) if self.observable == PENETRATION else (self.phi, self.omega_rad_s)

    @property
    def where(self) -> str:
        """The condition for a reader."""
        if self.observable == PENETRATION:
            return f"φ {self.phi:.3f}, {100 * self.depth_m:.1f} cm deep"
        return f"φ {self.phi:.3f}, ω {self.omega_rad_s:.3g} rad/s"


def next_trials(contenders: Sequence[Fit]) -> list[NextTrial]:
    """The measurements that tell most, best first, no two at one condition; none where none within reach tells."""
    found: list[NextTrial] = []
    for one, other in combinations(contenders[:4], 2):
        found += between(one, other)
    return _distinct(found)[:MOST]


def excluding(base: Fit, unseen: Sequence[Fit]) -> list[NextTrial]:
    """What would show each of the effects that are not seen but not excluded: the best for each, then more."""
    each = [between(base, other) for other in unseen]
    best = _distinct([trials[0] for trials in each if trials])
    more = _distinct([*best, *(trial for trials in each for trial in trials[1:])])
    return [*best, *(one for one in more if one not in best)][:MOST]


def between(one: Fit, other: Fit) -> list[NextTrial]:
    """Measurements by which two fits differ, the most telling first; also of what has not been measured yet."""
    found = [*_trials_between(one, other), *_readings_between(one, other)]
    telling = [trial for trial in found if trial.expected_gap_sd > LEAST_SD]
    return sorted(telling, key=lambda trial: -trial.expected_gap_sd)[: 4 * MOST]


def _distinct(trials: Sequence[NextTrial]) -> list[NextTrial]:
    chosen: list[NextTrial] = []
    for trial in sorted(trials, key=lambda trial: -trial.expected_gap_sd):
        if all(trial.condition != other.condition for other in chosen):
            chosen.append(trial)
    return chosen


def _trials_between(one: Fit, other: Fit) -> list[NextTrial]:
    cells = one.cells
    phi, omega = cells.level_phi[:, None], _finer(np.unique(np.round(cells.omega, 3)))[None, :]
    noise = np.where(np.isfinite(cells.noise), cells.noise, USUAL_NOISE)
    variance = noise**2 + sum(_variance(fit, phi, omega) for fit in (one, other))
    gap = np.abs(one.predict(phi, omega).observables - other.predict(phi, omega).observables) / np.sqrt(variance)
    found = []
    for flat in np.argsort(-gap, axis=None)[: 4 * MOST]:
        p, w, o = np.unravel_index(flat, gap.shape)
        size, at = float(gap[p, w, o]), (float(phi[p, 0]), float(omega[0, w]))
        found.append(NextTrial(*at, OBSERVABLES[o], _names(one, other), size, _replicates(size)))
    return found


def _readings_between(one: Fit, other: Fit) -> list[NextTrial]:
    """One reading a level, at the depth that tells most."""
    levels = one.cells.level_phi
    phi, depth = (grid.ravel() for grid in np.meshgrid(levels, DEPTHS_M, indexing="ij"))
    (force, spread), (its_force, its_spread) = (fit.press(phi, depth) for fit in (one, other))
    sd = np.sqrt((USUAL_SD * force) ** 2 + spread**2 + its_spread**2)
    gap = (np.abs(force - its_force) / sd).reshape(len(levels), -1)
    best = gap.argmax(axis=1)
    return [
        NextTrial(
            float(levels[i]), float("nan"), PENETRATION, _names(one, other), size, _replicates(size), DEPTHS_M[at]
        )
        for i, (at, size) in enumerate(zip(best, gap.max(axis=1).tolist(), strict=True))
    ]


def _names(one: Fit, other: Fit) -> tuple[str, str]:
    first, second = (" + ".join(fit.effects) or "base" for fit in (one, other))
    return first, second


def _replicates(size: float) -> int:
    return max(2, int(np.ceil((SETTLED_SD / max(size, 1e-3)) ** 2)))


def _variance(fit: Fit, phi: Array, omega: Array) -> Array:
    """Variance of a prediction, from not knowing the parameters and from the bed missing φ, ``(φ, ω, 4)``."""
    missed = fit.cells.phi_scatter
    sides = [fit.predict(phi + sign * missed, omega).observables for sign in (-1.0, 1.0)]
    return np.asarray(fit.uncertainty(phi, omega) ** 2 + (0.5 * (sides[1] - sides[0])) ** 2)


def _finer(omega: Array) -> Array:
    if len(omega) < 2:
        return omega
    steps = [np.linspace(a, b, FINER + 1, endpoint=False) for a, b in pairwise(omega)]
    return np.round(np.concatenate([*steps, omega[-1:]]), 2)
