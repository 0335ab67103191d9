"""Derivatives of the likelihood's residuals, and the space of what a fit's own parameters can absorb."""

import numpy as np

from sandbot_model.fitting.averaging import NODES, along_the_track, node_average
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.physics.arrays import Array, Bool
from sandbot_model.physics.walking import Footing

STEP = 1e-5
"""Relative step of the derivatives."""
DEPTH_STEP_M = 1e-8


def full_jacobian(problem: Problem, states: States) -> Array:
    """d(whitened prediction)/d(θ, ln k of every level, nuisances): a row for each of ``States.all_residuals``."""
    local = cell_jacobian(problem, states)
    cells, count, levels = problem.cells, states.theta.shape[1], states.ln_k.shape[1]
    full = np.zeros((len(local), len(cells), 4, count + levels))
    full[..., :count] = local[..., :count]
    each = np.arange(len(cells))
    full[:, each, :, count + cells.level] = np.moveaxis(local[..., count], 1, 0)
    full = np.concatenate([full.reshape(len(local), -1, count + levels), readings_jacobian(problem, states)], axis=1)
    if problem.nuisances is None:
        return full
    return _with_nuisances(full, problem.whitened(states.whiten, problem.nuisances), problem.nuisances.sd)


def _with_nuisances(jacobian: Array, shift: Array, sd: Array) -> Array:
    """A column for each nuisance, ``shift (rows, cells, 4, nuisances)``, and a row for its prior."""
    rows, values, unknowns = jacobian.shape
    wider = np.zeros((rows, values + len(sd), unknowns + len(sd)))
    wider[:, :values, :unknowns] = jacobian
    wider[:, : shift.shape[1] * shift.shape[2], unknowns:] = shift.reshape(rows, -1, len(sd))
    wider[:, values:, unknowns:] = np.diag(1 / sd)
    return wider


def cell_jacobian(problem: Problem, states: States) -> Array:
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
    inputs, params = problem.inputs(theta, ln_k, states.slope)
    shape = (count + 3, rows, len(problem.cells), len(NODES))
    feet = states.footing
    steady, virgin = (np.broadcast_to(d, shape).copy() for d in (feet.depth, feet.virgin_depth))
    steady[count + 1] -= DEPTH_STEP_M
    virgin[count + 1] -= DEPTH_STEP_M
    walker = problem.model.walker
    here = Footing(steady, feet.walking, virgin, feet.virgin_walking)
    values = np.broadcast_to(walker.observe(inputs, params, here).observables, (*shape, 4))
    steps = np.concatenate([step.T, np.full((1, rows), STEP), np.full((1, rows), -DEPTH_STEP_M)])[:, :, None, None]
    slope = (values[:-1] - values[-1]) / steps[..., None]
    sink = _sinking(walker.margin(inputs, params, steady, first_step=False), steps, feet.walking)
    sink_first = sink
    if walker.remembers:
        margin = walker.margin(inputs, params, virgin, first_step=True)
        sink_first = _sinking(margin, steps, feet.virgin_walking)
    by_depth, direct = slope[-1], slope[:-1]
    through_depth = np.concatenate(
        [by_depth[..., :3] * sink[..., None], by_depth[..., 3:] * sink_first[..., None]], axis=-1
    )
    _, weights = node_average(values[-1], along_the_track(walker))
    mean = np.einsum("rcgi,prcgi->rcip", weights, direct + through_depth)
    return np.asarray(states.whiten @ np.where(problem.measured[..., None], mean, 0.0))


def _sinking(margin: Array, steps: Array, walking: Bool) -> Array:
    """dd/dθ for each parameter and ln k, ``(parameters + 1, rows, cells, nodes)``."""
    margin = np.broadcast_to(margin, (len(steps) + 1, *walking.shape))
    slope = (margin[:-1] - margin[-1]) / steps
    stiff = slope[-1]
    # A depth at a jump of the margin does not move.
    moves = walking & (stiff > 1e-6)
    return np.where(moves, -slope[:-1] / np.where(moves, stiff, 1.0), 0.0)


def readings_jacobian(problem: Problem, states: States) -> Array:
    """d(model of the readings)/d(θ, ln k of a level) in standard deviations, ``(rows, readings, θ + levels)``."""
    rows, count = states.theta.shape
    readings = problem.cells.pressed
    if readings is None:
        return np.zeros((rows, 0, count + states.ln_k.shape[1]))
    step = STEP * np.maximum(np.abs(states.theta), 1e-3)
    theta = np.repeat(states.theta[None], count + 1, axis=0)
    theta[np.arange(count), :, np.arange(count)] += step.T
    ln_k = np.repeat(states.ln_k[None], count + 1, axis=0)
    ln_k[count] += STEP
    moved = problem.pressed(theta, ln_k, np.repeat(states.slope[None], count + 1, axis=0))
    steps = np.concatenate([step.T, np.full((1, rows), STEP)])
    each = (states.pressed - moved) / steps[..., None]
    found = np.zeros((rows, len(readings), count + ln_k.shape[-1]))
    found[..., :count] = np.moveaxis(each[:count], 0, -1)
    found[:, np.arange(len(readings)), count + readings.level] = each[count]
    return found


def tangent_basis(problem: Problem, states: States) -> Array:
    """Orthonormal columns ``(values, rank)`` that span the residuals a fit's own parameters can absorb."""
    basis, singular, _ = np.linalg.svd(full_jacobian(problem, states)[0], full_matrices=False)
    return np.asarray(basis[:, singular > 1e-9 * singular[0]])


def project_out(values: Array, basis: Array) -> Array:
    """``values (n, ...)`` with their component in the span of the basis removed."""
    return np.asarray(values - basis @ (basis.T @ values))
