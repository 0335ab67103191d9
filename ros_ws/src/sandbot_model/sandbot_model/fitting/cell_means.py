"""What a model says of the mean of every cell, and how far that scatters: the heart of ``likelihood``."""

from dataclasses import astuple, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting import kernels
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.operations import CompiledChains
from sandbot_model.fitting.points import SEEN, ArrayChains, Chains, Conditions, Points
from sandbot_model.fitting.switch import Switches, share_of_nodes, switches_of, turn
from sandbot_model.physics.arrays import Array, Bool, Ints
from sandbot_model.physics.averaging import (
    NODES,
    WEIGHTS,
    along_the_track,
    node_weights,
    share_between_trials,
)
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.walking import Footing, KCurve

LEAST_SPREAD = 1e-3
"""σ_k/k that is always averaged over: a bed is never perfect, and a fit needs a switch that is not a cliff."""
STEP = 1e-5
"""Relative step of the derivatives."""
DEPTH_STEP_M = 1e-8
FAR = 20.0
"""An offset of ln k that no bed has: a wild step goes no farther, and is taken back for its deviance."""


class Measured(NamedTuple):
    """Of the cell means: which values ``(cells, 4)`` count, these, covariance and its whitening ``(cells, 4, 4)``, and
    the ln of its determinant ``(cells,)``."""

    which: Bool
    mean: Array
    covariance: Array
    whiten: Array
    log_det: Array


class Said(NamedTuple):
    """What is said of the cells, see ``States``."""

    footing: Footing
    predicted: Array
    covariance: Array
    whiten: Array
    residual: Array
    deviance: Array


class CellMeans:
    """θ is ``(rows, parameters)``, ln k and dk/dφ are ``(rows, levels)``; ``moved (rows or 1, cells)`` is what ln k of
    a cell is off its level's by, ``ln_k_sd (cells,)`` the sd of ln k that a cell's replicates share."""

    def __init__(self, model: Model, cells: Cells, measured: Measured, ln_k_sd: Array) -> None:
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
        """Each way to turn the legs at the φ of every level, and which of them is a cell's."""
        turning = np.stack([self.cells.omega, *astuple(self.cells.clock)])
        (omega, *clock), of_cell = np.unique(turning, axis=1, return_inverse=True)
        level_phi = np.repeat(self.cells.level_phi[:, None], len(omega), axis=1)
        return Conditions.of(self.walker, omega, level_phi, Clock(*clock)), of_cell

    def said(self, theta: Array, ln_k: Array, slope: Array, moved: Array) -> Said:
        """Prediction and likelihood of all cells."""
        points, track = self._points(theta, ln_k, slope, moved)
        replicates = self._independent(ln_k, slope)
        footing, values, share = self._stood(points, self._apart(replicates))
        return self._judged(footing, share, values, track, replicates)

    def said_by_row(self, theta: Array, ln_k: Array, slope: Array, moved: Array) -> Said:
        """Prediction and likelihood of cell i by row i, in one row."""
        points, track = self._points(theta, ln_k, slope, moved, by_row=True)
        replicates = np.ascontiguousarray(_own(self._independent(ln_k, slope))[None])
        footing, values, share = self._stood(points, self._apart(replicates).T)
        parts = (np.ascontiguousarray(np.swapaxes(part, 0, 1)) for part in vars(footing).values())
        footing, share = Footing(*parts), np.ascontiguousarray(np.swapaxes(share, 0, 1))
        return self._judged(footing, share, np.ascontiguousarray(np.swapaxes(values, 1, 2)), track.T, replicates)

    def read(self, nuisances: Nuisances, said: Said, shared: Array) -> tuple[Said, Array]:
        """The same beside readings off their zero or scale, and all nuisances ``(rows, m)``; of these readings are the
        most likely ones where ``shared`` has none."""
        which, (sd, slope) = ~nuisances.moves_k, nuisances.of_readings
        without = said.whiten, said.predicted, said.residual, said.deviance
        told = np.ascontiguousarray(shared[:, which] / sd)
        values, predicted, residual, deviance = kernels.read(told, slope * sd, self.measured.which, without)
        found = shared.copy()
        found[:, which] = values * sd
        return said._replace(predicted=predicted, residual=residual, deviance=deviance), found

    def _stood(self, points: Points, apart: Bool) -> tuple[Footing, Array, Array]:
        """See ``CompiledChains.stood``; step by step where the chain could not be recorded."""
        if isinstance(self.chains, CompiledChains):
            return self.chains.stood(points, apart)
        footing = self.chains.footing(points)
        values = self.chains.values(NAMES, points, vars(footing).values())
        return footing, values, share_of_nodes(self._switches(points, footing, apart), points.shape)

    def _switches(self, points: Points, footing: Footing, apart: Bool) -> list[tuple[str, Switches]]:
        return switches_of(self.chains, points, footing, apart, remembers=self.walker.remembers)

    def _apart(self, replicates: Array) -> Bool:
        """Where replicates walk or swim each by itself: those that share more of k than they do not do so together."""
        return np.asarray(replicates >= 0.5 * self._replicates)

    def _judged(self, footing: Footing, share: Array, values: Array, track: Array, replicates: Array) -> Said:
        between = share_between_trials(self.along, self.cells.phi_scatter, track)
        of = self._weights(values, share), share, self.measured, between, replicates
        return Said(footing, *kernels.judged(values, footing.walking, WEIGHTS, *of))

    def jacobian(
        self,
        theta: Array,
        ln_k: Array,
        slope: Array,
        moved: Array,
        feet: Footing,
        whiten: Array,
        *,
        switches: bool,
    ) -> Array:
        """d(whitened prediction)/d(θ, ln k), ``(rows, cells, 4, parameters + 1)``; the last column is the cell's ln k.

        By the implicit function theorem on the force balance, dd/dθ = -(∂M/∂θ)/(∂M/∂d): one evaluation of the chain
        for all parameters at once, no solving, and no node across a switch. With ``switches`` these move as well.
        """
        rows, count = theta.shape
        here, _ = self._points(theta, ln_k, slope, moved)
        found = self._switches(here, feet, self._apart(self._independent(ln_k, slope)))
        step = STEP * np.maximum(np.abs(theta), 1e-3)
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
            turn(local, self.chains, points, margin, these, steps, of, along_the_track=self.along)
        return np.asarray(local)

    def spread(self, local: Array) -> Array:
        """The same with a column for ln k of each level, ``(rows, 4 cells, parameters + levels)``."""
        return np.asarray(kernels.spread(local, self._level, len(self.cells.level_phi)))

    def step(self, *of: Array | Bool) -> Array:
        """See ``kernels.damped_step``."""
        return np.asarray(kernels.damped_step(*of))

    def profiled(
        self, theta: Array, slope: Array, k_curve: Array, k_grid: Array, same: Array, cross: Array
    ) -> tuple[Array, Array]:
        """Least deviance over k for each θ ``(m,)``, and that k ``(m, levels)``; see ``starts``.

        ``same (m, levels, k)`` and ``cross (m, levels, k - 1)`` are S_00 and S_01 so far. Levels share a table of
        predictions unless something depends on φ.
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

    def _weights(self, values: Array, share: Array) -> Array:
        return node_weights(np.moveaxis(values, 0, -1), share) if self.along else share[..., None]

    def _points(
        self, theta: Array, ln_k: Array, slope: Array, moved: Array, *, by_row: bool = False
    ) -> tuple[Points, Array]:
        """The nodes of every cell, and the standard deviation of φ along its track ``(rows or 1, cells or 1)``.

        ``by_row``: those of cell i in row i alone.
        """
        cells, level_k, factor = self.cells, np.exp(ln_k), np.exp(np.clip(moved, -FAR, FAR))
        each = np.arange(len(cells)) if by_row else None
        where = self.at if each is None else self.at.some(each, each)
        curve = KCurve(cells.level_phi, level_k, inner=3)
        track, sigma_phi = np.zeros((1, 1)), self._sigma_phi
        if self.chains.varies_phi:
            k = level_k[:, cells.level] * factor
            at = Points(theta, where, _own(k)[:, None, None] if by_row else k[..., None], curve)
            feet = np.full(at.shape, 0.01), np.ones(at.shape)
            track = self.chains.values(("sigma_phi",), at, (*feet, *feet))[0, ..., 0]
            sigma_phi = np.hypot(cells.phi_scatter, track.T if by_row else track) + np.zeros(len(cells))
        k = kernels.node_k(level_k, slope, self._level, factor, sigma_phi, self.ln_k_sd, NODES, LEAST_SPREAD)
        return Points(theta, where, np.ascontiguousarray(_own(k)[:, None]) if by_row else k, curve), track

    def _independent(self, ln_k: Array, slope: Array) -> Array:
        """Replicates in terms of which the nodes' scatter is that of the mean ``(rows or 1, cells)``.

        n, down to 1 where all of it is shared.
        """
        if not self.ln_k_sd.any():
            return self._replicates[None]
        relative = np.abs(slope) / np.exp(ln_k) * self.cells.phi_scatter
        own, shared = np.maximum(relative, LEAST_SPREAD)[:, self.cells.level] ** 2, self.ln_k_sd**2
        return np.ascontiguousarray((own + shared) / (own / self._replicates + shared))


def _own(each: Array) -> Array:
    """Row i's value for cell i, ``(cells, ...)`` of ``(rows or 1, cells, ...)``."""
    at = np.arange(each.shape[1])
    return each[at % len(each), at]
