"""One model against one set of cells: predictions and their deviance.

The unknowns are the shared parameters θ and one ln k per φ level. The bed misses its set point by σ_φ, so a cell is an
average over k(φ); with G nodes x_g, w_g of Gauss-Hermite quadrature and the slope dk/dφ of the fitted curve,

    ȳ_c = Σ_g w_g y(k + dk/dφ σ_φ x_g, ω),   V_c = V_c0 + (scatter of y over the nodes)/n if the cell straddles a switch

Away from a switch the scatter is part of the pure error V_c0 already. Beside one, replicates walk and swim by chance:
the mean says little, the mixture's variance says so, and one such cell can't decide a fit.

What trials share (see ``nuisances``) is linear and Gaussian, adjusted at every point: u = argmin |r - Gu|² + |u/sd|².
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.averaging import NODES, WEIGHTS, along_the_track, node_average, share_between_trials
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.states import States
from sandbot_model.physics.arrays import Array, Bool
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Footing, Inputs, KCurve, Params

LEAST_SPREAD = 1e-3
"""σ_k/k that is always averaged over: a bed is never perfect, and a fit needs a switch that is not a cliff."""
WIDENED = 1.25
"""Scatter of a cell mean over its pure error from which the cell walks or swims by chance."""


class CellByCell(NamedTuple):
    """Each cell evaluated at parameters of its own: prediction ``(cells, 4)``, and ``(cells,)`` each
    widening, deviance and whether it walks."""

    predicted: Array
    widening: Array
    deviance: Array
    walks: Bool


@dataclass(frozen=True, eq=False)
class Problem:
    """Cells to fit. θ is ``(rows, parameters)``, ln k and dk/dφ are ``(rows, levels)``."""

    model: Model
    cells: Cells
    nuisances: Nuisances | None = None

    @cached_property
    def measured(self) -> Bool:
        """Which values ``(cells, 4)`` count."""
        return np.isfinite(self.cells.mean)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the cell means ``(cells, 4, 4)``, the unit matrix where nothing was measured."""
        both = self.measured[:, :, None] & self.measured[:, None, :]
        return np.where(both, self.cells.covariance, np.eye(4))

    @cached_property
    def log_det(self) -> Array:
        """ln |V_c0| ``(cells,)``."""
        return np.asarray(np.linalg.slogdet(self.covariance)[1])

    @cached_property
    def whiten(self) -> Array:
        """L⁻¹ with V_c0 = L Lᵀ, ``(cells, 4, 4)``."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    @cached_property
    def replicates(self) -> Array:
        """Replicates of a cell ``(cells,)``."""
        return np.asarray(self.cells.n.max(axis=1), dtype=float)

    def states(self, theta: Array, ln_k: Array, slope: Array, shared: Array | None = None) -> States:
        """Predict all cells and evaluate the likelihood; ``shared (rows, nuisances)`` as given, or the best."""
        inputs, params = self.inputs(theta, ln_k, slope)
        shape = (len(theta), len(self.cells), len(NODES))
        footing = self.model.walker.footing(inputs, params)
        values = self.model.walker.observe(inputs, params, footing).observables
        footing = Footing(*(np.broadcast_to(value, shape) for value in vars(footing).values()))
        values = np.broadcast_to(values, (*shape, 4))
        predicted, _ = node_average(values, along_the_track(self.model.walker))
        share = share_between_trials(self.model.walker, self.cells.phi_scatter, inputs, params)
        replicates = self._independent(ln_k, slope)
        covariance, whiten, log_det_change = self._mixture(values, predicted, footing.walking, share, replicates)
        gap = np.where(self.measured, self.cells.mean - predicted, 0.0)
        residual = np.einsum("rcij,rcj->rci", whiten, gap)
        prior = np.zeros((len(theta), 0))
        if self.nuisances is not None:
            shift = self.whitened(whiten, self.nuisances)
            shared = self.nuisances.adjusted(residual, shift) if shared is None else shared
            predicted = predicted + np.einsum("cim,rm->rci", self.nuisances.slope, shared)
            residual = residual - np.einsum("rcim,rm->rci", shift, shared)
            prior = -shared / self.nuisances.sd
        deviance = np.sum(residual**2, axis=2) + log_det_change
        slope = np.broadcast_to(slope, ln_k.shape)
        pressed = self.pressed(theta, ln_k, slope)
        return States(theta, ln_k, slope, footing, predicted, covariance, whiten, residual, deviance, pressed, prior)

    def whitened(self, whiten: Array, nuisances: Nuisances) -> Array:
        """d(whitened prediction)/d(nuisances), ``(rows, cells, 4, nuisances)``."""
        return np.asarray(whiten @ np.where(self.measured[..., None], nuisances.slope, 0.0))

    def pressed(self, theta: Array, ln_k: Array, slope: Array) -> Array:
        """Penetrometer readings minus model, in standard deviations ``(..., readings)``."""
        readings = self.cells.pressed
        if readings is None:
            return np.zeros((*theta.shape[:-1], 0))
        k = np.exp(ln_k)[..., readings.level] + slope[..., readings.level] * readings.away
        force = self.press(theta, k, self.cells.level_phi[readings.level] + readings.away, readings.depth)
        return np.asarray((readings.force - force) / readings.sd)

    def press(self, theta: Array, k: Array, phi: Array, depth: Array) -> Array:
        """Force [N] on a leg pressed slowly into virgin ground, of the shape of ``k (..., readings)``."""
        inputs, params = self.model.inputs(theta[..., None, :], k, 1e-6, phi)
        chain = self.model.walker.chain(inputs, params, depth[:, None], first_step=True, one_leg=True)
        return np.broadcast_to(chain.force + chain.extra_force, (*k.shape, 1))[..., 0]

    def _mixture(
        self, values: Array, predicted: Array, walking: Bool, share: Array, replicates: Array
    ) -> tuple[Array, Array, Array]:
        """Covariance, its whitening and ln |V_c|/|V_c0|: wider where the nodes of a cell both walk and swim."""
        rows = len(values)
        covariance = np.broadcast_to(self.covariance, (rows, *self.covariance.shape))
        whiten = np.broadcast_to(self.whiten, covariance.shape)
        log_det_change = np.zeros(values.shape[:2])
        row, cell = np.nonzero(walking.any(axis=2) & ~walking.all(axis=2))
        if not len(row):
            return covariance, whiten, log_det_change
        covariance, whiten = covariance.copy(), whiten.copy()
        share = np.broadcast_to(share, (rows, len(self.cells), 4))[row, cell, None, :]
        deviation = share * (values[row, cell] - predicted[row, cell, None, :])
        extra = np.einsum("g,sgi,sgj->sij", WEIGHTS, deviation, deviation) / replicates[row, cell, None, None]
        both = self.measured[cell, :, None] & self.measured[cell, None, :]
        wider = covariance[row, cell] + np.where(both, extra, 0.0)
        root = np.linalg.cholesky(wider)
        covariance[row, cell], whiten[row, cell] = wider, np.linalg.inv(root)
        log_det_change[row, cell] = 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1) - self.log_det[cell]
        return covariance, whiten, log_det_change

    def cell_by_cell(self, theta: Array, ln_k: Array, slope: Array, shared: Array | None = None) -> CellByCell:
        """What is predicted for cell i with row i of θ ``(cells, parameters)`` and ln k ``(cells, levels)``."""
        states = self.states(theta, ln_k, slope, shared)
        at = np.arange(len(self.cells))
        return CellByCell(
            states.predicted[at, at],
            self.widening(states.covariance[at, at]),
            states.cell_deviance[at, at],
            states.footing.walking[at, at].mean(axis=1) > 0.5,
        )

    def widening(self, covariance: Array) -> Array:
        """How much wider a cell mean's speed scatters than by pure error ``(cells,)``; above 1 beside a switch."""
        speed = Observable.speed
        return np.asarray(np.sqrt(covariance[:, speed, speed] / self.covariance[:, speed, speed]))

    def away_from_switch(self, widening: Array) -> Bool:
        """Cells ``(cells,)`` where neither the replicates nor the model walk or swim by chance.

        A model that has most of them beside the switch does not know what it says, and is scored on all.
        """
        clear = widening < WIDENED
        return np.asarray(~self.cells.own_scatter & (clear | (clear.mean() < 0.5)))

    def inputs(self, theta: Array, ln_k: Array, slope: Array) -> tuple[Inputs, Params]:
        """Inputs of shape ``(..., cells, nodes)`` for θ ``(..., parameters)`` and ln k ``(..., levels)``."""
        cells = self.cells
        level_k = np.exp(ln_k)
        k = level_k[..., cells.level, None]
        inputs, params = self.model.inputs(
            theta[..., None, None, :],
            k,
            cells.omega[:, None],
            cells.level_phi[cells.level][:, None],
            cells.clock[:, None],
            KCurve(cells.level_phi, level_k, inner=3),
        )
        sigma_phi = np.hypot(cells.phi_scatter, self.model.walker.sigma_phi(inputs, params))
        sigma_k = np.maximum(np.abs(slope)[..., cells.level, None] * sigma_phi, LEAST_SPREAD * k)
        if self._ln_k_scatter is not None:
            sigma_k = np.hypot(sigma_k, self._ln_k_scatter[:, None] * k)
        return replace(inputs, k_n_per_m=np.maximum(k + sigma_k * NODES, 0.05 * k)), params

    @cached_property
    def _ln_k_scatter(self) -> Array | None:
        """Standard deviation of ln k that a cell's replicates share ``(cells,)``; None: none."""
        return None if self.nuisances is None else self.nuisances.ln_k_sd

    def _independent(self, ln_k: Array, slope: Array) -> Array:
        """Replicates in terms of which the nodes' scatter is that of the mean ``(rows, cells)``: n, down to 1 where all
        of it is shared."""
        shape = (len(ln_k), len(self.cells))
        if self._ln_k_scatter is None:
            return np.broadcast_to(self.replicates, shape)
        relative = np.broadcast_to(np.abs(slope), ln_k.shape) / np.exp(ln_k) * self.cells.phi_scatter
        own, shared = np.maximum(relative, LEAST_SPREAD)[:, self.cells.level] ** 2, self._ln_k_scatter**2
        return np.asarray((own + shared) / (own / self.replicates + shared))
