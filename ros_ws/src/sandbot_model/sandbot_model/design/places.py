"""Where trials can be run, and how well one measures there."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sandbot_model.data.clustering import OMEGA_TOLERANCE
from sandbot_model.data.conditions import Cells
from sandbot_model.design.start import Condition
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.arrays import Array, Bool
from sandbot_model.physics.gait import Clock, clock
from sandbot_model.physics.observables import shared_variance, usual_noise

WIDE = 2.0
"""Standard deviations that a bed may miss its φ by."""
SAME_PHI = 0.002
"""A level that was measured so near to a φ asked for is that φ: beds are prepared to 0.001."""


@dataclass(frozen=True, eq=False)
class Places:
    """Conditions at which trials can be run, ``n`` of them, and how well one trial measures there."""

    phi: Array
    omega: Array
    clock: Clock
    """How legs turn there."""
    noise: Array
    """Variance of one trial ``(n, 4)``; infinite where an observable is not measured."""
    shared: Array
    """Variance that the trials of one condition share ``(n, 4)``."""
    known: Array
    """Variance of the mean of the trials there have been ``(n, 4)``; infinite where there were none."""

    @classmethod
    def of(cls, conditions: Sequence[Condition], fit: Fit, gait: str = "") -> "Places":
        """As the trials of a fit were measured; in the gait of most of them, if in none that is named."""
        cells, gait = fit.cells, gait or fit.gait
        turning = clock([gait])[0]
        asked, omega = np.array(conditions, dtype=float).T
        # Beside a switch the bed's own miss of its target decides which side a prediction is on.
        nearest = cells.level_phi[np.abs(asked[:, None] - cells.level_phi).argmin(axis=1)]
        phi = np.where(np.abs(nearest - asked) < SAME_PHI, nearest, asked)
        sides = [fit.predict(phi + sign * cells.phi_scatter, omega, turning).observables for sign in (-1.0, 1.0)]
        noise = scatter_of_one(cells) ** 2 + (0.5 * (sides[1] - sides[0])) ** 2
        same = _same(omega, cells, gait)
        there = np.asarray(same & (phi[:, None] == cells.level_phi[cells.level]))
        by_chance = _by_chance(fit, phi, omega, turning, there)
        noise = np.where(_measured(cells, same) & ~by_chance[:, None], noise, np.inf)
        shared = shared_variance(cells.accuracy, fit.predict(phi, omega, turning).observables)
        return cls(phi, omega, turning, noise, shared, _known(cells, there))

    @cached_property
    def precision(self) -> Array:
        """1/σ of one trial ``(n, 4)``; 0 where an observable is not measured."""
        return np.asarray(1.0 / np.sqrt(self.noise))


def scatter_of_one(cells: Cells) -> Array:
    """Standard deviation of one trial of each observable ``(4,)``: as replicates say, else as is usual."""
    return np.where(np.isfinite(cells.noise), cells.noise, usual_noise(cells.accuracy))


def _known(cells: Cells, there: Bool) -> Array:
    variance = np.diagonal(cells.covariance, axis1=1, axis2=2)[there.argmax(axis=1)]
    return np.where(there.any(axis=1, keepdims=True) & np.isfinite(variance), variance, np.inf)


def _by_chance(fit: Fit, phi: Array, omega: Array, turning: Clock, there: Bool) -> Bool:
    """Where the bed's misses of φ decide whether the robot walks or swims: that tells nothing of a model ``(n,)``."""
    cells, problem = fit.cells, fit.problem
    walks = [fit.predict(phi + sign * WIDE * cells.phi_scatter, omega, turning).walking for sign in (-1.0, 1.0)]
    clear = problem.away_from_switch(problem.widening(fit.state.covariance[0]))
    return np.asarray((walks[0] != walks[1]) | (there & ~clear).any(axis=1))


def _measured(cells: Cells, same: Bool) -> Bool:
    """Whether each observable can be had at each frequency: a camera may be too slow for one that no trial had."""
    had: Bool = np.isfinite(cells.mean)
    at_it = (same[:, :, None] & had).any(axis=1)
    return np.asarray(np.where(np.any(same, axis=1, keepdims=True), at_it, had.any(axis=0)))


def _same(omega: Array, cells: Cells, gait: str) -> Bool:
    """Which cells are of the gait, at each frequency ``(n, cells)``."""
    near = np.abs(omega[:, None] / cells.omega - 1.0) < OMEGA_TOLERANCE
    return np.asarray(near & (np.array(cells.gait) == gait))
