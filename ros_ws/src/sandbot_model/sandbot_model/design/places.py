"""Where trials can be run, and how well one measures there."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sandbot_model.data.clustering import OMEGA_TOLERANCE
from sandbot_model.data.conditions import Cells
from sandbot_model.design.start import Condition
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.arrays import Array
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
    noise: Array
    """Variance of one trial ``(n, 4)``; infinite where an observable is not measured."""
    shared: Array
    """Variance that the trials of one condition share ``(n, 4)``."""
    known: Array
    """Variance of the mean of the trials there have been ``(n, 4)``; infinite where there were none."""

    @classmethod
    def of(cls, conditions: Sequence[Condition], fit: Fit) -> "Places":
        """As the trials of a fit were measured."""
        cells = fit.cells
        asked, omega = np.array(conditions, dtype=float).T
        # Beside a switch the bed's own miss of its target decides which side a prediction is on.
        nearest = cells.level_phi[np.abs(asked[:, None] - cells.level_phi).argmin(axis=1)]
        phi = np.where(np.abs(nearest - asked) < SAME_PHI, nearest, asked)
        sides = [fit.predict(phi + sign * cells.phi_scatter, omega).observables for sign in (-1.0, 1.0)]
        noise = scatter_of_one(cells) ** 2 + (0.5 * (sides[1] - sides[0])) ** 2
        noise = np.where(_measured(cells, omega) & ~_by_chance(fit, phi, omega)[:, None], noise, np.inf)
        shared = shared_variance(cells.accuracy, fit.predict(phi, omega).observables)
        return cls(phi, omega, noise, shared, _known(cells, phi, omega))

    @cached_property
    def precision(self) -> Array:
        """1/σ of one trial ``(n, 4)``; 0 where an observable is not measured."""
        return np.asarray(1.0 / np.sqrt(self.noise))


def scatter_of_one(cells: Cells) -> Array:
    """Standard deviation of one trial of each observable ``(4,)``: as replicates say, else as is usual."""
    return np.where(np.isfinite(cells.noise), cells.noise, usual_noise(cells.accuracy))


def _known(cells: Cells, phi: Array, omega: Array) -> Array:
    there = _same(omega, cells) & (phi[:, None] == cells.level_phi[cells.level])
    variance = np.diagonal(cells.covariance, axis1=1, axis2=2)[there.argmax(axis=1)]
    return np.where(there.any(axis=1)[:, None] & np.isfinite(variance), variance, np.inf)


def _by_chance(fit: Fit, phi: Array, omega: Array) -> NDArray[np.bool_]:
    """Where the bed's misses of φ decide whether the robot walks or swims: that tells nothing of a model ``(n,)``."""
    cells, problem = fit.cells, fit.problem
    walks = [fit.predict(phi + sign * WIDE * cells.phi_scatter, omega).walking for sign in (-1.0, 1.0)]
    same = _same(omega, cells) & (phi[:, None] == cells.level_phi[cells.level])
    clear = problem.away_from_switch(problem.widening(fit.state.covariance[0]))
    return np.asarray((walks[0] != walks[1]) | (same & ~clear).any(axis=1))


def _measured(cells: Cells, omega: Array) -> NDArray[np.bool_]:
    """Whether each observable can be had at each frequency: a camera may be too slow for one that no trial had."""
    had: NDArray[np.bool_] = np.isfinite(cells.mean)
    same = _same(omega, cells)
    at_it = (same[:, :, None] & had).any(axis=1)
    return np.asarray(np.where(np.any(same, axis=1, keepdims=True), at_it, had.any(axis=0)))


def _same(omega: Array, cells: Cells) -> NDArray[np.bool_]:
    """Which cells are at each frequency ``(n, cells)``."""
    return np.asarray(np.abs(omega[:, None] / cells.omega - 1.0) < OMEGA_TOLERANCE)
