"""What a model says of the mean of every cell, and how far that scatters: the heart of ``likelihood``."""

from typing import NamedTuple

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting import kernels
from sandbot_model.fitting.averaging import NODES, WEIGHTS, along_the_track, node_weights, share_between_trials
from sandbot_model.fitting.operations import CompiledChains
from sandbot_model.fitting.points import SEEN, ArrayChains, Chains, Conditions, Points
from sandbot_model.physics.arrays import Array, Bool
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.tape import record
from sandbot_model.physics.walking import Footing, KCurve

LEAST_SPREAD = 1e-3
"""σ_k/k that is always averaged over: a bed is never perfect, and a fit needs a switch that is not a cliff."""
STEP = 1e-5
"""Relative step of the derivatives."""
DEPTH_STEP_M = 1e-8


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
    """θ is ``(rows, parameters)``, ln k and dk/dφ are ``(rows, levels)``; ``ln_k_sd (cells,)`` is the sd of ln k that a
    cell's replicates share."""

    def __init__(self, model: Model, cells: Cells, measured: Measured, ln_k_sd: Array) -> None:
        self.cells, self.measured, self.ln_k_sd = cells, measured, ln_k_sd
        tape = record(model.walker)
        self.chains: Chains = ArrayChains(model) if tape is None else CompiledChains(model, tape)
        self.along = along_the_track(model.walker)
        self.at = Conditions.of(model.walker, cells.omega, cells.level_phi[cells.level], cells.clock)
        self._level = np.ascontiguousarray(cells.level)
        self._replicates = np.asarray(cells.n.max(axis=1), dtype=float)

    def said(self, theta: Array, ln_k: Array, slope: Array) -> Said:
        """Prediction and likelihood of all cells."""
        slope = slope + np.zeros_like(ln_k)
        points, track = self._points(theta, ln_k, slope)
        footing = self.chains.footing(points)
        values = np.moveaxis(self.chains.values(NAMES, points, vars(footing).values()), 0, -1)
        weights = node_weights(values, self.along)
        share = share_between_trials(self.along, self.cells.phi_scatter, track)
        replicates = self._independent(ln_k, slope)
        found = kernels.judged(values, footing.walking, weights, WEIGHTS, self.measured, share, replicates)
        return Said(footing, *found)

    def jacobian(self, theta: Array, ln_k: Array, slope: Array, feet: Footing, whiten: Array) -> Array:
        """d(whitened prediction)/d(θ, ln k), ``(rows, cells, 4, parameters + 1)``; the last column is the level's ln k.

        By the implicit function theorem on the force balance, dd/dθ = -(∂M/∂θ)/(∂M/∂d): one evaluation of the chain
        for all parameters at once, no solving, and never across a switch.
        """
        rows, count = theta.shape
        step = STEP * np.maximum(np.abs(theta), 1e-3)
        # First axis: each parameter, ln k, depth, and the point itself.
        moved = np.repeat(theta[None], count + 3, axis=0)
        moved[np.arange(count), :, np.arange(count)] += step.T
        ln_k = np.repeat(ln_k[None], count + 3, axis=0)
        ln_k[count] += STEP
        depths = np.repeat(np.stack([feet.depth, feet.virgin_depth])[:, None], count + 3, axis=1)
        depths[:, count + 1] -= DEPTH_STEP_M
        walking = [np.repeat(walks[None], count + 3, axis=0) for walks in (feet.walking, feet.virgin_walking)]
        steps = np.concatenate([step.T, np.full((1, rows), STEP), np.full((1, rows), -DEPTH_STEP_M)], axis=0)
        steps = np.ascontiguousarray(steps)
        slopes = np.repeat(slope[None], count + 3, axis=0)
        points, _ = self._points(*(part.reshape(-1, part.shape[-1]) for part in (moved, ln_k, slopes)))
        at = [part.reshape(points.shape) for part in (depths[0], walking[0], depths[1], walking[1])]
        values = self.chains.values(SEEN, points, at).reshape(len(SEEN), count + 3, *feet.depth.shape)
        seen = np.moveaxis(values[: len(NAMES)], 0, -1)
        weights = node_weights(seen[-1], self.along)
        return np.asarray(
            kernels.local_jacobian(
                seen,
                values[-2],
                values[-1],
                steps,
                feet.walking,
                feet.virgin_walking,
                weights,
                self.measured.which,
                whiten,
            )
        )

    def _points(self, theta: Array, ln_k: Array, slope: Array) -> tuple[Points, Array]:
        """The nodes of every cell, and the standard deviation of φ along its track ``(rows or 1, cells or 1)``."""
        cells, level_k = self.cells, np.exp(ln_k)
        curve = KCurve(cells.level_phi, level_k, inner=3)
        track = np.zeros((1, 1))
        if self.chains.varies_phi:
            at = Points(theta, self.at, level_k[:, cells.level, None], curve)
            feet = np.full(at.shape, 0.01), np.ones(at.shape)
            track = self.chains.values(("sigma_phi",), at, (*feet, *feet))[0, ..., 0]
        sigma_phi = np.hypot(cells.phi_scatter, track) + np.zeros(len(cells))
        k = kernels.node_k(level_k, slope, self._level, sigma_phi, self.ln_k_sd, NODES, LEAST_SPREAD)
        return Points(theta, self.at, k, curve), track

    def _independent(self, ln_k: Array, slope: Array) -> Array:
        """Replicates in terms of which the nodes' scatter is that of the mean ``(rows or 1, cells)``.

        n, down to 1 where all of it is shared.
        """
        if not self.ln_k_sd.any():
            return self._replicates[None]
        relative = np.abs(slope) / np.exp(ln_k) * self.cells.phi_scatter
        own, shared = np.maximum(relative, LEAST_SPREAD)[:, self.cells.level] ** 2, self.ln_k_sd**2
        return np.ascontiguousarray((own + shared) / (own / self._replicates + shared))
