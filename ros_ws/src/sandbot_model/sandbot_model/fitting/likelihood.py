"""One model against one set of cells: predictions and their deviance.

The unknowns are the shared parameters θ and one ln k per φ level. The bed misses its set point by σ_φ, so a cell is an
average over k(φ); with G nodes x_g, w_g of Gauss-Hermite quadrature and the slope dk/dφ of the fitted curve,

    ȳ_c = Σ_g w_g y(k + dk/dφ σ_φ x_g, ω),   V_c = V_c0 + (scatter of y over the nodes)/n if the cell straddles a switch

Away from a switch the scatter is part of the pure error V_c0 already. Beside one, replicates walk and swim by chance,
and w_g are the shares of the normal distribution that lie on either side (see ``switch``): the mean says little, the
mixture's variance says so, and one such cell can't decide a fit.

What trials share (see ``nuisances``) is Gaussian: offsets of the bed move k itself, readings off their zero or scale
what is predicted. Each is an unknown like the others, its prior a reading of 0 ± sd.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.states import States
from sandbot_model.physics.arrays import Array, Bool, Ints
from sandbot_model.physics.model import Model
from sandbot_model.physics.walking import KCurve

if TYPE_CHECKING:
    from sandbot_model.fitting.cell_means import CellMeans

FEW = 4
"""One cell in so many is looked at first where most of what is tried is far off."""
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
    def cell_means(self) -> "CellMeans":
        """What the model says of the cells."""
        # Imported now: no command that fits nothing waits for the compiler.
        from sandbot_model.fitting.cell_means import CellMeans, Measured

        own = Measured(self.measured, self.cells.mean, self.covariance, self.whiten, self.log_det)
        scatter = np.zeros(len(self.cells)) if self.nuisances is None else self.nuisances.ln_k_sd
        return CellMeans(self.model, self.cells, own, scatter)

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

    def without(self, cells: int | Ints) -> "Problem":
        """The same for all cells but these."""
        nuisances = None if self.nuisances is None else self.nuisances.without(cells)
        return Problem(self.model, self.cells.without(cells), nuisances)

    @cached_property
    def few(self) -> "Problem":
        """The same for one cell in ``FEW``: what deviates so much on these deviates more on all."""
        # Multiples of the golden ratio take some of every level and of every ω.
        return self.without(np.flatnonzero(np.arange(len(self.cells)) * 0.6180339887 % 1.0 >= 1.0 / FEW))

    def states(self, theta: Array, ln_k: Array, slope: Array, shared: Array | None = None) -> States:
        """Predict all cells and evaluate the likelihood.

        ``shared (rows or 1, nuisances)`` are the values of the nuisances; without them the bed's are what they are
        about. Readings off their zero or scale, where not a number, are what suits best.
        """
        slope, found = slope + np.zeros_like(ln_k), self._shared(len(theta), shared)
        said = self.cell_means.said(theta, ln_k, slope, self.moved(found))
        prior = np.zeros((len(theta), 0))
        if self.nuisances is not None:
            said, found = self.cell_means.read(self.nuisances, said, found)
            prior = -found / self.nuisances.sd
        footing, predicted, covariance, whiten, residual, deviance = said
        pressed = self.pressed(theta, ln_k, slope)
        likelihood = covariance, whiten, residual, deviance, pressed, prior
        return States(theta, ln_k, slope, footing, predicted, *likelihood)

    def shared(self, states: States) -> Array:
        """The values of the nuisances ``(rows, nuisances)``."""
        return states.shared if self.nuisances is None else -states.shared * self.nuisances.sd

    def bed(self, states: States) -> Array:
        """The same, readings not a number."""
        shared = self.shared(states)
        return shared if self.nuisances is None else np.where(self.nuisances.moves_k, shared, np.nan)

    def moved(self, shared: Array) -> Array:
        """What nuisances move ln k of the cells by ``(rows, cells)``."""
        if self.nuisances is None:
            return np.zeros((len(shared), len(self.cells)))
        return np.ascontiguousarray(np.nan_to_num(shared) @ self.nuisances.by_ln_k.T)

    def _shared(self, rows: int, shared: Array | None) -> Array:
        if self.nuisances is None:
            return np.zeros((rows, 0))
        about = np.where(self.nuisances.moves_k, self.nuisances.about, np.nan)
        found = about[None] if shared is None else shared
        return np.broadcast_to(found, (rows, found.shape[1]))

    def whitened(self, whiten: Array, slope: Array) -> Array:
        """d(whitened prediction) ``(rows, cells, 4, n)`` of slopes ``(cells, 4, n)``."""
        return np.asarray(whiten @ np.where(self.measured[..., None], slope, 0.0))

    def pressed(self, theta: Array, ln_k: Array, slope: Array) -> Array:
        """Penetrometer readings minus model, whitened ``(..., readings)``."""
        missed, readings = self.missed_forces(theta, ln_k, slope), self.cells.pressed
        return missed if readings is None else missed @ readings.whiten.T

    def missed_forces(self, theta: Array, ln_k: Array, slope: Array) -> Array:
        """Penetrometer readings minus model [N] ``(..., readings)``."""
        readings = self.cells.pressed
        if readings is None:
            return np.zeros((*theta.shape[:-1], 0))
        k = np.exp(ln_k)[..., readings.level] + slope[..., readings.level] * readings.away
        force = self.press(theta, ln_k, k, self.cells.level_phi[readings.level] + readings.away, readings.depth)
        return np.asarray(readings.force - force)

    def press(self, theta: Array, ln_k: Array, k: Array, phi: Array, depth: Array) -> Array:
        """Force [N] on a leg pressed slowly into virgin ground, of the shape of ``k (..., readings)``.

        Ground at another φ is harder than ``k`` by as much as the curve through the levels, ``ln_k (..., levels)``.
        """
        curve = KCurve(self.cells.level_phi, np.exp(ln_k), inner=2)

        def elsewhere(there: Array) -> Array:
            return np.asarray(k[..., None] + curve(there) - curve(phi[:, None]))

        inputs, params = self.model.inputs(theta[..., None, :], k, 1e-6, phi, k_of_phi=elsewhere)
        chain = self.model.walker.chain(inputs, params, depth[:, None], first_step=True, one_leg=True)
        return np.broadcast_to(chain.force + chain.extra_force, (*k.shape, 1))[..., 0]

    def cell_by_cell(self, theta: Array, ln_k: Array, slope: Array, shared: Array | None = None) -> CellByCell:
        """What is predicted for cell i with row i of θ ``(cells, parameters)`` and ln k ``(cells, levels)``."""
        slope, found = slope + np.zeros_like(ln_k), self._shared(len(theta), shared)
        said = self.cell_means.said_by_row(theta, ln_k, slope, self.moved(found))
        predicted, residual, deviance = said.predicted[0], said.residual[0], said.deviance[0]
        if self.nuisances is not None:
            which, (_, reading) = ~self.nuisances.moves_k, self.nuisances.of_readings
            shift = self.whitened(said.whiten, reading)[0]
            left = residual - np.einsum("cim,cm->ci", shift, found[:, which])
            predicted = predicted + np.einsum("cim,cm->ci", reading, found[:, which])
            deviance = deviance + np.sum(left**2 - residual**2, axis=1)
        walks = said.footing.walking[0].mean(axis=1) > 0.5
        return CellByCell(predicted, self.widening(said.covariance[0]), deviance, walks)

    def widening(self, covariance: Array) -> Array:
        """How much wider what is measured of a cell's mean scatters than by pure error ``(cells,)``; above 1 beside a
        switch, which a speed hardly sees where legs walk no faster than they swim."""
        own, wider = (np.diagonal(each, axis1=1, axis2=2) for each in (self.covariance, covariance))
        return np.asarray(np.sqrt(np.where(self.measured, wider / own, 1.0).max(axis=1)))

    def away_from_switch(self, widening: Array) -> Bool:
        """Cells ``(cells,)`` where neither the replicates nor the model walk or swim by chance.

        A model that has most of them beside the switch does not know what it says, and is scored on all.
        """
        clear = widening < WIDENED
        return np.asarray(~self.cells.own_scatter & (clear | (clear.mean() < 0.5)))
