"""Where trials can be run, and how precise one is there."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_model.data.clustering import OMEGA_TOLERANCE
from sandbot_model.data.conditions import Cells
from sandbot_model.design.start import Condition
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.gait import Clock, clock
from sandbot_model.physics.observables import shared_variance, usual_noise

WIDE = 2.0
"""Deviation of φ from its target, in standard deviations, that a bed may have."""
SAME_PHI = 0.002
"""A measured level this close to a requested φ counts as that φ: beds are prepared to 0.001."""


@dataclass(frozen=True, eq=False)
class Places:
    """The ``n`` conditions in which trials can be run, and the precision of one trial in each."""

    phi: Floats
    omega: Floats
    clock: Clock
    """How legs turn there."""
    noise: Floats
    """Variance of one trial ``(n, 4)``; infinite where an observable is not measured."""
    shared: Floats
    """Variance that the trials of one condition share ``(n, 4)``."""
    known: Floats
    """Variance of the mean of the trials so far ``(n, 4)``; infinite where there are none."""

    @classmethod
    def of(cls, conditions: Sequence[Condition], fit: Fit, gait: str = "") -> "Places":
        """Conditions measured as the trials of a fit were; in the gait of most of them if none is given."""
        cells, gait = fit.cells, gait or fit.gait
        turning = clock([gait])[0]
        requested, omega = np.array(conditions, dtype=float).T
        # Near a switch, the bed's deviation from its target decides which side of it a prediction is on.
        nearest = cells.level_phi[np.abs(requested[:, None] - cells.level_phi).argmin(axis=1)]
        phi = np.where(np.abs(nearest - requested) < SAME_PHI, nearest, requested)
        sides = [fit.predict(phi + sign * cells.phi_scatter, omega, turning).observables for sign in (-1.0, 1.0)]
        noise = scatter_of_one(cells) ** 2 + (0.5 * (sides[1] - sides[0])) ** 2
        same = _same_omega_and_gait(omega, cells, gait)
        there = np.asarray(same & (phi[:, None] == cells.level_phi[cells.level]))
        by_chance = _walks_by_chance(fit, phi, omega, turning, there)
        noise = np.where(_measurable(cells, same) & ~by_chance[:, None], noise, np.inf)
        shared = shared_variance(cells.accuracy, fit.predict(phi, omega, turning).observables)
        return cls(phi, omega, turning, noise, shared, _variance_so_far(cells, there))

    @cached_property
    def precision(self) -> Floats:
        """1/σ of one trial ``(n, 4)``; 0 where an observable is not measured."""
        return np.asarray(1.0 / np.sqrt(self.noise))


def scatter_of_one(cells: Cells) -> Floats:
    """Standard deviation of one trial of each observable ``(4,)``: from replicates, else the usual one."""
    return np.where(np.isfinite(cells.noise), cells.noise, usual_noise(cells.accuracy))


def _variance_so_far(cells: Cells, there: Bools) -> Floats:
    variance = np.diagonal(cells.covariance, axis1=1, axis2=2)[there.argmax(axis=1)]
    return np.where(there.any(axis=1, keepdims=True) & np.isfinite(variance), variance, np.inf)


def _walks_by_chance(fit: Fit, phi: Floats, omega: Floats, turning: Clock, there: Bools) -> Bools:
    """Where the scatter of φ decides whether the robot walks or swims, so that a trial says nothing ``(n,)``."""
    cells, problem = fit.cells, fit.problem
    walks = [fit.predict(phi + sign * WIDE * cells.phi_scatter, omega, turning).walking for sign in (-1.0, 1.0)]
    clear = problem.away_from_switch(problem.widening(fit.state.covariance[0]))
    return np.asarray((walks[0] != walks[1]) | (there & ~clear).any(axis=1))


def _measurable(cells: Cells, same: Bools) -> Bools:
    """Whether each observable can be measured at each frequency: where no trial has it, the camera may be too slow."""
    measured: Bools = np.isfinite(cells.mean)
    at_omega = (same[:, :, None] & measured).any(axis=1)
    return np.asarray(np.where(np.any(same, axis=1, keepdims=True), at_omega, measured.any(axis=0)))


def _same_omega_and_gait(omega: Floats, cells: Cells, gait: str) -> Bools:
    """Which cells have the gait and each of the frequencies ``(n, cells)``."""
    near = np.abs(omega[:, None] / cells.omega - 1.0) < OMEGA_TOLERANCE
    return np.asarray(near & (np.array(cells.gait) == gait))
