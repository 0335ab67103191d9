"""One model against one set of cells: predictions and their deviance.

The unknowns are the shared parameters θ and one ln k per φ level. The bed's φ scatters by σ_φ about its set point, so a
cell mean is an average over k(φ); with G nodes x_g, w_g of Gauss-Hermite quadrature and the fitted curve's slope dk/dφ,

    ȳ_c = Σ_g w_g y(k + dk/dφ σ_φ x_g, ω),   V_c = V_c0 + (scatter of y over the nodes)/n if the cell straddles a switch

Away from a switch between walking and swimming this scatter is already part of the pure error V_c0. Near one,
replicates walk or swim by chance, and w_g are the fractions of the normal distribution on either side (see ``switch``):
the variance of the mixture gives such a cell little weight, so that no single one decides a fit.

Nuisance parameters (see ``nuisances``) are Gaussian: offsets of the bed move k itself, zero offsets and scale errors of
the readings move the prediction. Each is an unknown like the others, its prior a measurement of 0 ± sd.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.states import States
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import KCurve

if TYPE_CHECKING:
    from sandbot_model.fitting.cell_means import CellMeans

SUBSET = 4
"""One cell in so many is evaluated first, to reject most of what a scan tries."""
WIDENED = 1.25
"""Scatter of a cell mean over its pure error above which the cell walks or swims by chance."""


class CellByCell(NamedTuple):
    """Each cell evaluated at parameters of its own: prediction ``(cells, 4)``; widening, deviance and whether it walks,
    ``(cells,)`` each."""

    predicted: Floats
    widening: Floats
    deviance: Floats
    walks: Bools


@dataclass(frozen=True, eq=False)
class Problem:
    """Cells to fit. θ is ``(rows, parameters)``, ln k and dk/dφ are ``(rows, levels)``."""

    model: Model
    cells: Cells
    nuisances: Nuisances | None = None

    @cached_property
    def cell_means(self) -> "CellMeans":
        """The model's predictions of the cell means."""
        # Imported now: no command that fits nothing waits for the compiler.
        from sandbot_model.fitting.cell_means import CellMeans, Measured

        own = Measured(self.measured, self.cells.mean, self.covariance, self.whiten, self.log_det)
        scatter = np.zeros(len(self.cells)) if self.nuisances is None else self.nuisances.ln_k_sd
        return CellMeans(self.model, self.cells, own, scatter)

    @cached_property
    def measured(self) -> Bools:
        """Which values ``(cells, 4)`` count."""
        return np.isfinite(self.cells.mean)

    @property
    def values(self) -> int:
        """Number of cell means and penetrometer readings to fit."""
        return int(self.measured.sum()) + len(self.cells.pressed or ())

    @property
    def fitted(self) -> int:
        """Number of unknowns that are fitted: parameters that are not held, and k of every level."""
        return len(self.model.parameters) - len(self.model.held) + len(self.cells.level_phi)

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of the cell means ``(cells, 4, 4)``, the unit matrix where nothing was measured."""
        both = self.measured[:, :, None] & self.measured[:, None, :]
        return np.where(both, self.cells.covariance, np.eye(len(Observable)))

    @cached_property
    def log_det(self) -> Floats:
        """ln |V_c0| ``(cells,)``."""
        return np.asarray(np.linalg.slogdet(self.covariance)[1])

    @cached_property
    def whiten(self) -> Floats:
        """L⁻¹ with V_c0 = L Lᵀ, ``(cells, 4, 4)``."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    def without(self, cells: int | Ints) -> "Problem":
        """The same for all cells but these."""
        nuisances = None if self.nuisances is None else self.nuisances.without(cells)
        return Problem(self.model, self.cells.without(cells), nuisances)

    @cached_property
    def subset(self) -> "Problem":
        """The same for one cell in ``SUBSET``: their deviance is a lower bound for that of all cells."""
        # Multiples of the golden ratio take some of every level and of every ω.
        return self.without(np.flatnonzero(np.arange(len(self.cells)) * 0.6180339887 % 1.0 >= 1.0 / SUBSET))

    def states(self, theta: Floats, ln_k: Floats, slope: Floats, shared: Floats | None = None) -> States:
        """Predict all cells and evaluate the likelihood.

        ``shared (rows or 1, nuisances)`` are the values of the nuisances; by default the bed's take their initial
        values. Zero offsets and scale errors that are NaN take their most likely values.
        """
        slope, found = slope + np.zeros_like(ln_k), self._shared(len(theta), shared)
        cells = self.cell_means.evaluate(theta, ln_k, slope, self.moved(found))
        prior = np.zeros((len(theta), 0))
        if self.nuisances is not None:
            cells, found = self.cell_means.with_reading_errors(self.nuisances, cells, found)
            prior = (self.nuisances.mean - found) / self.nuisances.sd
        footing, predicted, covariance, whiten, residual, deviance = cells
        pressed = self.pressed(theta, ln_k, slope)
        likelihood = covariance, whiten, residual, deviance, pressed, prior
        return States(theta, ln_k, slope, footing, predicted, *likelihood)

    def shared(self, states: States) -> Floats:
        """The values of the nuisances ``(rows, nuisances)``."""
        own = self.nuisances
        return states.shared if own is None else own.mean - states.shared * own.sd

    def bed(self, states: States) -> Floats:
        """The same with NaN for those of the readings, which ``states`` then determines."""
        shared = self.shared(states)
        return shared if self.nuisances is None else np.where(self.nuisances.moves_k, shared, np.nan)

    @property
    def bed_starts(self) -> Floats:
        """Nuisances ``(rows, nuisances)`` from which a search begins, NaN for those of the readings."""
        own = self.nuisances
        return np.zeros((1, 0)) if own is None else np.where(own.moves_k, own.starts, np.nan)

    def moved(self, shared: Floats) -> Floats:
        """Change of the cells' ln k due to the nuisances ``(rows, cells)``."""
        if self.nuisances is None:
            return np.zeros((len(shared), len(self.cells)))
        return np.ascontiguousarray(np.nan_to_num(shared) @ self.nuisances.by_ln_k.T)

    def _shared(self, rows: int, shared: Floats | None) -> Floats:
        if self.nuisances is None:
            return np.zeros((rows, 0))
        initial = np.where(self.nuisances.moves_k, self.nuisances.initial, np.nan)
        found = initial[None] if shared is None else shared
        return np.broadcast_to(found, (rows, found.shape[1]))

    def whitened(self, whiten: Floats, slope: Floats) -> Floats:
        """Whitened slopes ``(rows, cells, 4, n)`` from slopes of the prediction ``(cells, 4, n)``."""
        return np.asarray(whiten @ np.where(self.measured[..., None], slope, 0.0))

    def pressed(self, theta: Floats, ln_k: Floats, slope: Floats) -> Floats:
        """Penetrometer readings minus model, whitened ``(..., readings)``."""
        missed, readings = self.missed_forces(theta, ln_k, slope), self.cells.pressed
        return missed if readings is None else missed @ readings.whiten.T

    def missed_forces(self, theta: Floats, ln_k: Floats, slope: Floats) -> Floats:
        """Penetrometer readings minus model [N] ``(..., readings)``."""
        readings = self.cells.pressed
        if readings is None:
            return np.zeros((*theta.shape[:-1], 0))
        k = np.exp(ln_k)[..., readings.level] + slope[..., readings.level] * readings.away
        force = self.press(theta, ln_k, k, self.cells.level_phi[readings.level] + readings.away, readings.depth)
        return np.asarray(readings.force - force)

    def press(self, theta: Floats, ln_k: Floats, k: Floats, phi: Floats, depth: Floats) -> Floats:
        """Force [N] on a leg pressed slowly into virgin ground, of the shape of ``k (..., readings)``.

        Ground at another φ differs from ``k`` by as much as the curve through the levels does, ``ln_k (..., levels)``.
        """
        curve = KCurve(self.cells.level_phi, np.exp(ln_k), inner=2)

        def elsewhere(there: Floats) -> Floats:
            return np.asarray(k[..., None] + curve(there) - curve(phi[:, None]))

        inputs, params = self.model.inputs(theta[..., None, :], k, 1e-6, phi, k_of_phi=elsewhere)
        chain = self.model.walker.chain(inputs, params, depth[:, None], first_step=True, one_leg=True)
        return np.broadcast_to(chain.force + chain.extra_force, (*k.shape, 1))[..., 0]

    def cell_by_cell(self, theta: Floats, ln_k: Floats, slope: Floats, shared: Floats | None) -> CellByCell:
        """Prediction and likelihood of cell i with row i of θ ``(cells, parameters)`` and ln k ``(cells, levels)``."""
        slope, found = slope + np.zeros_like(ln_k), self._shared(len(theta), shared)
        cells = self.cell_means.evaluate_by_row(theta, ln_k, slope, self.moved(found))
        predicted, residual, deviance = cells.predicted[0], cells.residual[0], cells.deviance[0]
        if self.nuisances is not None:
            which, (_, reading) = ~self.nuisances.moves_k, self.nuisances.of_readings
            shift = self.whitened(cells.whiten, reading)[0]
            left = residual - np.einsum("cim,cm->ci", shift, found[:, which])
            predicted = predicted + np.einsum("cim,cm->ci", reading, found[:, which])
            deviance = deviance + np.sum(left**2 - residual**2, axis=1)
        walks = cells.footing.walking[0].mean(axis=1) > 0.5
        return CellByCell(predicted, self.widening(cells.covariance[0]), deviance, walks)

    def widening(self, covariance: Floats) -> Floats:
        """Standard deviation of a cell mean over that of pure error ``(cells,)``, above 1 near a switch: the largest of
        its observables, since speed alone shows no switch where walking is no faster than swimming."""
        own, wider = (np.diagonal(each, axis1=1, axis2=2) for each in (self.covariance, covariance))
        return np.asarray(np.sqrt(np.where(self.measured, wider / own, 1.0).max(axis=1)))

    def away_from_switch(self, widening: Floats) -> Bools:
        """Cells ``(cells,)`` where neither the replicates nor the model walk or swim by chance.

        A model that puts most cells near the switch is scored on all.
        """
        clear = widening < WIDENED
        return np.asarray(~self.cells.own_scatter & (clear | (clear.mean() < 0.5)))
