"""A model's prediction of the mean of every cell, with its covariance: the core of ``likelihood``."""

from dataclasses import astuple, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting import kernels
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.operations import CompiledChains
from sandbot_model.fitting.points import SEEN, ArrayChains, Chains, Conditions, Points
from sandbot_model.fitting.states import STEP, parameter_steps
from sandbot_model.fitting.switch import Switches, add_switch_slopes, share_of_nodes, switches_of
from sandbot_model.physics.averaging import NODES, WEIGHTS, along_the_track, node_weights, share_between_trials
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.walking import Footing, KCurve

LEAST_SPREAD = 1e-3
"""Least σ_k/k averaged over: no bed is perfectly uniform, and a switch must not be a cliff to a fit."""
DEPTH_STEP_M = 1e-8
FAR = 20.0
"""Clip of an offset of ln k, beyond any bed's: a step that reaches it is rejected for its deviance."""


class Measured(NamedTuple):
    """Measured cell means: which exist and their values ``(cells, 4)``, covariance and its whitening ``(cells, 4, 4)``,
    ln of its determinant ``(cells,)``."""

    which: Bools
    mean: Floats
    covariance: Floats
    whiten: Floats
    log_det: Floats


class Evaluation(NamedTuple):
    """Prediction and likelihood of the cells, see ``States``."""

    footing: Footing
    predicted: Floats
    covariance: Floats
    whiten: Floats
    residual: Floats
    deviance: Floats


class CellMeans:
    """θ is ``(rows, parameters)``, ln k and dk/dφ are ``(rows, levels)``; ``moved (rows or 1, cells)`` is the offset of
    a cell's ln k from its level's, ``ln_k_sd (cells,)`` the sd of ln k that a cell's replicates share."""

    def __init__(self, model: Model, cells: Cells, measured: Measured, ln_k_sd: Floats) -> None:
        self.cells, self.measured, self.ln_k_sd = cells, measured, ln_k_sd
        self.chains: Chains = ArrayChains(model) if model.tape is None else CompiledChains(model, model.tape)
        self.along = along_the_track(model.walker)
        self.at = Conditions.of(model.walker, cells.omega, cells.level_phi[cells.level], cells.clock)
        self.walker = model.walker
        self._level = np.ascontiguousarray(cells.level)
        self._replicates = np.asarray(cells.n.max(axis=1), dtype=float)
        self._sigma_phi = np.full((1, len(cells)), cells.phi_scatter)

    @cached_property
    def _table(self) -> tuple[Conditions, Ints]:
        """Each distinct (ω, clock) at the φ of every level, and the index of each cell's."""
        turning = np.stack([self.cells.omega, *astuple(self.cells.clock)])
        (omega, *clock), of_cell = np.unique(turning, axis=1, return_inverse=True)
        level_phi = np.repeat(self.cells.level_phi[:, None], len(omega), axis=1)
        return Conditions.of(self.walker, omega, level_phi, Clock(*clock)), of_cell

    def evaluate(self, theta: Floats, ln_k: Floats, slope: Floats, moved: Floats) -> Evaluation:
        """Prediction and likelihood of all cells."""
        points, track = self._points(theta, ln_k, slope, moved)
        replicates = self._effective_replicates(ln_k, slope)
        footing, values, share = self._footing_and_values(points, self._independent(replicates))
        return self._likelihood(footing, share, values, track, replicates)

    def evaluate_by_row(self, theta: Floats, ln_k: Floats, slope: Floats, moved: Floats) -> Evaluation:
        """Prediction and likelihood of cell i at row i of the parameters, in one row."""
        points, track = self._points(theta, ln_k, slope, moved, by_row=True)
        replicates = np.ascontiguousarray(_diagonal(self._effective_replicates(ln_k, slope))[None])
        footing, values, share = self._footing_and_values(points, self._independent(replicates).T)
        parts = (np.ascontiguousarray(np.swapaxes(part, 0, 1)) for part in vars(footing).values())
        footing, share = Footing(*parts), np.ascontiguousarray(np.swapaxes(share, 0, 1))
        return self._likelihood(footing, share, np.ascontiguousarray(np.swapaxes(values, 1, 2)), track.T, replicates)

    def with_reading_errors(self, nuisances: Nuisances, cells: Evaluation, shared: Floats) -> tuple[Evaluation, Floats]:
        """The same with zero offsets and scale errors of the readings, and the values of all nuisances ``(rows, m)``:
        those of the readings are the most likely ones where ``shared`` is NaN."""
        which, (sd, slope) = ~nuisances.moves_k, nuisances.of_readings
        without = cells.whiten, cells.predicted, cells.residual, cells.deviance
        given = np.ascontiguousarray(shared[:, which] / sd)
        values, predicted, residual, deviance = kernels.with_reading_errors(
            given, slope * sd, self.measured.which, without
        )
        found = shared.copy()
        found[:, which] = values * sd
        return cells._replace(predicted=predicted, residual=residual, deviance=deviance), found

    def _footing_and_values(self, points: Points, independent: Bools) -> tuple[Footing, Floats, Floats]:
        """See ``CompiledChains.footing_and_values``; computed on arrays where the chain could not be recorded."""
        if isinstance(self.chains, CompiledChains):
            return self.chains.footing_and_values(points, independent)
        footing = self.chains.footing(points)
        values = self.chains.values(NAMES, points, vars(footing).values())
        return footing, values, share_of_nodes(self._switches(points, footing, independent), points.shape)

    def _switches(self, points: Points, footing: Footing, independent: Bools) -> list[tuple[str, Switches]]:
        return switches_of(self.chains, points, footing, independent, remembers=self.walker.remembers)

    def _independent(self, replicates: Floats) -> Bools:
        """Cells whose replicates walk or swim independently: if most of k's scatter is shared, they do so together."""
        return np.asarray(replicates >= 0.5 * self._replicates)

    def _likelihood(
        self, footing: Footing, share: Floats, values: Floats, track: Floats, replicates: Floats
    ) -> Evaluation:
        between = share_between_trials(self.along, self.cells.phi_scatter, track)
        of = self._weights(values, share), share, self.measured, between, replicates
        return Evaluation(footing, *kernels.cell_likelihood(values, footing.walking, WEIGHTS, *of))

    def jacobian(
        self,
        theta: Floats,
        ln_k: Floats,
        slope: Floats,
        moved: Floats,
        feet: Footing,
        whiten: Floats,
        *,
        switches: bool,
    ) -> Floats:
        """d(whitened prediction)/d(θ, ln k), ``(rows, cells, 4, parameters + 1)``; the last column is the cell's ln k.

        By the implicit function theorem on the force balance, dd/dθ = -(∂M/∂θ)/(∂M/∂d): one evaluation of the chain
        for all parameters at once, without solving for the depth and without moving a node across a switch. With
        ``switches`` the derivatives due to moving switches are added.
        """
        rows, count = theta.shape
        here, _ = self._points(theta, ln_k, slope, moved)
        found = self._switches(here, feet, self._independent(self._effective_replicates(ln_k, slope)))
        step = parameter_steps(theta)
        # First axis: each parameter, ln k, depth, and the point itself.
        theta = np.repeat(theta[None], count + 3, axis=0)
        theta[np.arange(count), :, np.arange(count)] += step.T
        ln_k = np.repeat(ln_k[None], count + 3, axis=0)
        ln_k[count] += STEP
        at = [np.repeat(part[None], count + 3, axis=0) for part in vars(feet).values()]
        for depth in at[::2]:
            depth[count + 1] -= DEPTH_STEP_M
        steps = np.concatenate([step.T, np.full((1, rows), STEP), np.full((1, rows), -DEPTH_STEP_M)], axis=0)
        slopes, offsets = (np.repeat(part[None], count + 3, axis=0) for part in (slope, moved))
        points, _ = self._points(*(part.reshape(-1, part.shape[-1]) for part in (theta, ln_k, slopes, offsets)))
        seen = self.chains.seen_moved(points, [part.reshape(points.shape) for part in at], rows)
        seen = seen.reshape(len(SEEN), count + 3, *feet.depth.shape)
        values = seen[: len(NAMES), -1]
        weights = self._weights(values, share_of_nodes(found, here.shape))
        holds, which = (feet.walking, feet.virgin_walking), self.measured.which
        local = kernels.local_jacobian(seen, np.ascontiguousarray(steps), *holds, weights, which, whiten)
        for margin, these in found if switches else ():
            of = values, whiten, which
            add_switch_slopes(local, self.chains, points, margin, these, steps, of, along_the_track=self.along)
        return np.asarray(local)

    def spread(self, local: Floats) -> Floats:
        """The same with a column for ln k of each level, ``(rows, 4 cells, parameters + levels)``."""
        return np.asarray(kernels.spread(local, self._level, len(self.cells.level_phi)))

    def step(self, *of: Floats | Bools) -> Floats:
        """See ``kernels.damped_step``."""
        return np.asarray(kernels.damped_step(*of))

    def profiled(
        self, theta: Floats, slope: Floats, k_curve: Floats, k_grid: Floats, same: Floats, cross: Floats
    ) -> tuple[Floats, Floats]:
        """Least deviance over k for each θ ``(m,)``, and the minimising k ``(m, levels)``; see ``starts``.

        ``same (m, levels, k)`` and ``cross (m, levels, k - 1)`` are the sums S_00 and S_01 to be added to. All levels
        share one table of predictions unless something else than k depends on φ.
        """
        cells, (at, of_cell) = self.cells, self._table
        phi = at.phi if self.chains.uses_phi else at.phi[:1]
        every = replace(at, phi=np.tile(phi, (len(theta), 1)))
        points = Points(np.repeat(theta, len(phi), axis=0), every, k_grid[None, None], KCurve(cells.level_phi, k_curve))
        values = self.chains.values(NAMES, points, vars(self.chains.footing(points)).values())
        sigma_k = np.zeros((len(theta), len(cells)))
        if self.chains.varies_phi:
            feet = np.full(points.shape, 0.01), np.ones(points.shape)
            track = self.chains.values(("sigma_phi",), points, (*feet, *feet))[0].reshape(len(theta), -1)[:, :1]
            sigma_k = track * np.abs(slope)[cells.level]
        table = values.reshape(len(NAMES), len(theta), len(phi), *points.shape[1:])
        found = kernels.profiled(
            table, of_cell, self.measured, self._level, k_grid, sigma_k, NODES, WEIGHTS, same, cross
        )
        return found[0], found[1]

    def _weights(self, values: Floats, share: Floats) -> Floats:
        return node_weights(np.moveaxis(values, 0, -1), share) if self.along else share[..., None]

    def _points(
        self, theta: Floats, ln_k: Floats, slope: Floats, moved: Floats, *, by_row: bool = False
    ) -> tuple[Points, Floats]:
        """The nodes of every cell, and the standard deviation of φ along its track ``(rows or 1, cells or 1)``.

        With ``by_row``, only those of cell i in row i.
        """
        cells, level_k, factor = self.cells, np.exp(ln_k), np.exp(np.clip(moved, -FAR, FAR))
        each = np.arange(len(cells)) if by_row else None
        where = self.at if each is None else self.at.some(each, each)
        curve = KCurve(cells.level_phi, level_k, inner=3)
        track, sigma_phi = np.zeros((1, 1)), self._sigma_phi
        if self.chains.varies_phi:
            k = level_k[:, cells.level] * factor
            at = Points(theta, where, _diagonal(k)[:, None, None] if by_row else k[..., None], curve)
            feet = np.full(at.shape, 0.01), np.ones(at.shape)
            track = self.chains.values(("sigma_phi",), at, (*feet, *feet))[0, ..., 0]
            sigma_phi = np.hypot(cells.phi_scatter, track.T if by_row else track) + np.zeros(len(cells))
        k = kernels.node_k(level_k, slope, self._level, factor, sigma_phi, self.ln_k_sd, NODES, LEAST_SPREAD)
        return Points(theta, where, np.ascontiguousarray(_diagonal(k)[:, None]) if by_row else k, curve), track

    def _effective_replicates(self, ln_k: Floats, slope: Floats) -> Floats:
        """Effective number of replicates ``(rows or 1, cells)``: variance over the nodes divided by that of the mean.

        It is n, down to 1 where replicates share all of the scatter.
        """
        if not self.ln_k_sd.any():
            return self._replicates[None]
        relative = np.abs(slope) / np.exp(ln_k) * self.cells.phi_scatter
        own, shared = np.maximum(relative, LEAST_SPREAD)[:, self.cells.level] ** 2, self.ln_k_sd**2
        return np.ascontiguousarray((own + shared) / (own / self._replicates + shared))


def _diagonal(each: Floats) -> Floats:
    """The value of cell i in row i: ``(cells, ...)`` from ``(rows or 1, cells, ...)``."""
    at = np.arange(each.shape[1])
    return each[at % len(each), at]
