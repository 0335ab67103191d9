"""One model against one set of cells: predictions, their deviance and their derivatives.

The unknowns are the shared parameters θ and one ln k per φ level. The bed misses its set point by σ_φ, so a cell is an
average over k(φ); with G nodes x_g, w_g of Gauss-Hermite quadrature and the slope dk/dφ of the fitted curve,

    ȳ_c = Σ_g w_g y(k + dk/dφ σ_φ x_g, ω),   V_c = V_c0 + (scatter of y over the nodes)/n if the cell straddles a switch

Away from a switch the scatter is part of the pure error V_c0 already. Beside one, replicates walk and swim by chance:
the mean says little, the mixture's variance says so, and one such cell can't decide a fit.

What trials share (see ``nuisances``) is linear and Gaussian, adjusted at every point: u = argmin |r - Gu|² + |u/sd|².
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.physics.arrays import Array, Bool, Ints
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Footing, Inputs, KCurve, Params

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
NODES = _NODES
LEAST_SPREAD = 1e-3
"""σ_k/k that is always averaged over: a bed is never perfect, and a fit needs a switch that is not a cliff."""
STEP = 1e-5
"""Relative step of the derivatives."""
DEPTH_STEP_M = 1e-8
STEPS = 10
"""Steps over which a trial averages what varies along the track; about as many as four periods have."""
WIDENED = 1.25
"""Scatter of a cell mean over its pure error from which the cell walks or swims by chance."""


@dataclass(frozen=True, eq=False)
class States:
    """Predictions and likelihood at several points of the search at once; the first axis of every array is the point
    (row)."""

    theta: Array
    ln_k: Array
    slope: Array
    footing: Footing
    predicted: Array
    covariance: Array
    whiten: Array
    residual: Array
    cell_deviance: Array
    pressed: Array
    """Penetrometer readings minus model in standard deviations ``(rows, readings)``."""
    shared: Array
    """Minus the nuisances in units of their priors ``(rows, nuisances)``: a reading of 0 each."""

    @property
    def deviance(self) -> Array:
        """χ² plus what the mixture's wider variance costs, -2 ln likelihood up to a constant ``(rows,)``."""
        prior = np.sum(self.pressed**2, axis=1) + np.sum(self.shared**2, axis=1)
        return np.asarray(self.cell_deviance.sum(axis=1) + prior)

    @property
    def missed(self) -> Array:
        """All whitened residuals: cells, readings, priors, ``(rows, 4 cells + readings + nuisances)``."""
        return np.concatenate([self.residual.reshape(len(self.residual), -1), self.pressed, self.shared], axis=1)

    def take(self, rows: Ints) -> "States":
        """Some of the rows."""
        arrays = {name: value[rows] for name, value in vars(self).items() if name != "footing"}
        return States(footing=Footing(*(value[rows] for value in vars(self.footing).values())), **arrays)

    def where(self, better: Bool, other: "States") -> "States":
        """Rows of ``other`` where ``better (rows,)``, else of these."""

        def pick(mine: Any, its: Any) -> Any:
            return np.where(better.reshape(-1, *(1,) * (mine.ndim - 1)), its, mine)

        arrays = {n: pick(v, getattr(other, n)) for n, v in vars(self).items() if n != "footing"}
        feet = [pick(m, i) for m, i in zip(vars(self.footing).values(), vars(other.footing).values(), strict=True)]
        return States(footing=Footing(*feet), **arrays)


class OneByOne(NamedTuple):
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
        inputs, params = self._inputs(theta, ln_k, slope)
        shape = (len(theta), len(self.cells), len(NODES))
        footing = self.model.walker.footing(inputs, params)
        values = self.model.walker.observe(inputs, params, footing).observables
        footing = Footing(*(np.broadcast_to(value, shape) for value in vars(footing).values()))
        values = np.broadcast_to(values, (*shape, 4))
        predicted, _ = self._average(values)
        share = self._share_between_trials(inputs, params)
        replicates = self._independent(ln_k, slope)
        covariance, whiten, surprise = self._mixture(values, predicted, footing.walking, share, replicates)
        gap = np.where(self.measured, self.cells.mean - predicted, 0.0)
        residual = np.einsum("rcij,rcj->rci", whiten, gap)
        prior = np.zeros((len(theta), 0))
        if self.nuisances is not None:
            shift = self.whitened(whiten, self.nuisances)
            shared = self.nuisances.adjusted(residual, shift) if shared is None else shared
            predicted = predicted + np.einsum("cim,rm->rci", self.nuisances.slope, shared)
            residual = residual - np.einsum("rcim,rm->rci", shift, shared)
            prior = -shared / self.nuisances.sd
        deviance = np.sum(residual**2, axis=2) + surprise
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

    def pressed_jacobian(self, states: States) -> Array:
        """d(model of the readings)/d(θ, ln k of a level) in standard deviations, ``(rows, readings, θ + levels)``."""
        rows, count = states.theta.shape
        readings = self.cells.pressed
        if readings is None:
            return np.zeros((rows, 0, count + states.ln_k.shape[1]))
        step = STEP * np.maximum(np.abs(states.theta), 1e-3)
        theta = np.repeat(states.theta[None], count + 1, axis=0)
        theta[np.arange(count), :, np.arange(count)] += step.T
        ln_k = np.repeat(states.ln_k[None], count + 1, axis=0)
        ln_k[count] += STEP
        moved = self.pressed(theta, ln_k, np.repeat(states.slope[None], count + 1, axis=0))
        steps = np.concatenate([step.T, np.full((1, rows), STEP)])
        each = (states.pressed - moved) / steps[..., None]
        found = np.zeros((rows, len(readings), count + ln_k.shape[-1]))
        found[..., :count] = np.moveaxis(each[:count], 0, -1)
        found[:, np.arange(len(readings)), count + readings.level] = each[count]
        return found

    def _average(self, values: Array) -> tuple[Array, Array]:
        """Average over the nodes (axis -2) and the weight of each node's change in it, of the shape of ``values``.

        Trials differ in φ: an average over nodes. Where φ also varies along the track, a trial's lift is that of the
        median step and its peak that of the best one; its speed is the average still, as every step takes as long.
        """
        weights = np.broadcast_to(WEIGHTS[:, None], values.shape)
        if not self._along_the_track:
            return np.einsum("g,...gi->...i", WEIGHTS, values), weights
        weights = weights.copy()
        weights[..., Observable.lift] = np.arange(len(NODES)) == len(NODES) // 2
        reached = np.where(np.abs(NODES) < 2, values[..., Observable.peak_speed], -np.inf)
        weights[..., Observable.peak_speed] = np.arange(len(NODES)) == reached.argmax(axis=-1)[..., None]
        return np.sum(weights * values, axis=-2), weights

    @cached_property
    def _along_the_track(self) -> bool:
        return any(effect.along_the_track for effect in self.model.walker.effects)

    def _share_between_trials(self, inputs: Inputs, params: Params) -> Array:
        """Standard deviation over trials as a share of that over steps, ``(rows or 1, cells or 1, 4)``.

        What varies along the track a trial averages over its steps; the first step happens once, and the best of all
        steps varies as much as a single step.
        """
        if not self._along_the_track:
            return np.ones((1, 1, 4))
        track = self.model.walker.sigma_phi(inputs, params)[..., 0]
        between = self.cells.phi_scatter**2
        averaged = np.sqrt((between + track**2 / STEPS) / np.maximum(between + track**2, 1e-18))
        plain = np.ones_like(averaged)
        return np.stack([averaged, averaged, plain, plain], axis=-1)

    def _mixture(
        self, values: Array, predicted: Array, walking: Bool, share: Array, replicates: Array
    ) -> tuple[Array, Array, Array]:
        """Covariance, its whitening and ln |V_c|/|V_c0|: wider where the nodes of a cell both walk and swim."""
        rows = len(values)
        covariance = np.broadcast_to(self.covariance, (rows, *self.covariance.shape))
        whiten = np.broadcast_to(self.whiten, covariance.shape)
        surprise = np.zeros(values.shape[:2])
        row, cell = np.nonzero(walking.any(axis=2) & ~walking.all(axis=2))
        if not len(row):
            return covariance, whiten, surprise
        covariance, whiten = covariance.copy(), whiten.copy()
        share = np.broadcast_to(share, (rows, len(self.cells), 4))[row, cell, None, :]
        deviation = share * (values[row, cell] - predicted[row, cell, None, :])
        extra = np.einsum("g,sgi,sgj->sij", WEIGHTS, deviation, deviation) / replicates[row, cell, None, None]
        both = self.measured[cell, :, None] & self.measured[cell, None, :]
        wider = covariance[row, cell] + np.where(both, extra, 0.0)
        root = np.linalg.cholesky(wider)
        covariance[row, cell], whiten[row, cell] = wider, np.linalg.inv(root)
        surprise[row, cell] = 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1) - self.log_det[cell]
        return covariance, whiten, surprise

    def each_by_its_own(self, theta: Array, ln_k: Array, slope: Array, shared: Array | None = None) -> OneByOne:
        """What is predicted for cell i with row i of θ ``(cells, parameters)`` and ln k ``(cells, levels)``."""
        states = self.states(theta, ln_k, slope, shared)
        at = np.arange(len(self.cells))
        return OneByOne(
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
        sure = widening < WIDENED
        return np.asarray(~self.cells.own_scatter & (sure | (sure.mean() < 0.5)))

    def jacobian(self, states: States) -> Array:
        """d(whitened prediction)/d(θ, ln k), ``(rows, cells, 4, parameters + 1)``; the last column is the level's ln k.

        By the implicit function theorem on the force balance, dd/dθ = -(∂M/∂θ)/(∂M/∂d): one evaluation of the chain
        for all parameters at once, no solving, and never across a switch.
        """
        rows, count = states.theta.shape
        step = STEP * np.maximum(np.abs(states.theta), 1e-3)
        # First axis: each parameter, ln k, depth, and the point itself.
        theta = np.repeat(states.theta[None], count + 3, axis=0)
        theta[np.arange(count), :, np.arange(count)] += step.T
        ln_k = np.repeat(states.ln_k[None], count + 3, axis=0)
        ln_k[count] += STEP
        inputs, params = self._inputs(theta, ln_k, states.slope)
        shape = (count + 3, rows, len(self.cells), len(NODES))
        feet = states.footing
        steady, virgin = (np.broadcast_to(d, shape).copy() for d in (feet.depth, feet.virgin_depth))
        steady[count + 1] -= DEPTH_STEP_M
        virgin[count + 1] -= DEPTH_STEP_M
        walker = self.model.walker
        here = Footing(steady, feet.walking, virgin, feet.virgin_walking)
        values = np.broadcast_to(walker.observe(inputs, params, here).observables, (*shape, 4))
        steps = np.concatenate([step.T, np.full((1, rows), STEP), np.full((1, rows), -DEPTH_STEP_M)])[:, :, None, None]
        slope = (values[:-1] - values[-1]) / steps[..., None]
        sink = self._sinking(walker.margin(inputs, params, steady, first_step=False), steps, feet.walking)
        sink_first = sink
        if walker.remembers:
            margin = walker.margin(inputs, params, virgin, first_step=True)
            sink_first = self._sinking(margin, steps, feet.virgin_walking)
        by_depth, direct = slope[-1], slope[:-1]
        through_depth = np.concatenate(
            [by_depth[..., :3] * sink[..., None], by_depth[..., 3:] * sink_first[..., None]], axis=-1
        )
        _, weights = self._average(values[-1])
        mean = np.einsum("rcgi,prcgi->rcip", weights, direct + through_depth)
        return np.asarray(states.whiten @ np.where(self.measured[..., None], mean, 0.0))

    def _sinking(self, margin: Array, steps: Array, walking: Bool) -> Array:
        """dd/dθ for each parameter and ln k, ``(parameters + 1, rows, cells, nodes)``."""
        margin = np.broadcast_to(margin, (len(steps) + 1, *walking.shape))
        slope = (margin[:-1] - margin[-1]) / steps
        stiff = slope[-1]
        # A depth at a jump of the margin does not move.
        moves = walking & (stiff > 1e-6)
        return np.where(moves, -slope[:-1] / np.where(moves, stiff, 1.0), 0.0)

    def _inputs(self, theta: Array, ln_k: Array, slope: Array) -> tuple[Inputs, Params]:
        """Inputs of shape ``(..., cells, nodes)`` for θ ``(..., parameters)`` and ln k ``(..., levels)``."""
        cells = self.cells
        level_k = np.exp(ln_k)
        k = level_k[..., cells.level, None]
        inputs, params = self.model.inputs(
            theta[..., None, None, :],
            k,
            cells.omega[:, None],
            cells.level_phi[cells.level][:, None],
            cells.slow_phase_ratio[:, None],
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
