"""Derivatives of the likelihood's residuals, and the space of residuals that a fit's unknowns can absorb."""

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import STEP, States, parameter_steps


def full_jacobian(problem: Problem, states: States, *, switches: bool = False) -> Floats:
    """d(whitened prediction)/d(θ, ln k of every level, nuisances): a row for each of ``States.all_residuals``.

    With ``switches``, which descents use, the fraction of replicates that walk near a switch moves as well. Whatever
    linearises a fit must leave it out: it is linear within a fraction of the switch's width only.
    """
    local = cell_jacobian(problem, states, switches=switches)
    full = problem.cell_means.spread(local)
    if problem.cells.pressed is not None:
        full = np.concatenate([full, readings_jacobian(problem, states)], axis=1)
    if problem.nuisances is None:
        return full
    shift = local[..., -1, None] * problem.nuisances.by_ln_k[:, None, :]
    _, reading = problem.nuisances.of_readings
    shift[..., ~problem.nuisances.moves_k] = problem.whitened(states.whiten, reading)
    return _with_nuisances(full, shift, problem.nuisances.sd)


def _with_nuisances(jacobian: Floats, shift: Floats, sd: Floats) -> Floats:
    """Append a column for each nuisance, ``shift (rows, cells, 4, nuisances)``, and a row for its prior."""
    rows, values, unknowns = jacobian.shape
    wider = np.zeros((rows, values + len(sd), unknowns + len(sd)))
    wider[:, :values, :unknowns] = jacobian
    of_cells = shift.shape[1] * shift.shape[2]
    wider[:, :of_cells, unknowns:] = shift.reshape(rows, of_cells, len(sd))
    wider[:, values:, unknowns:] = np.diag(1 / sd)
    return wider


def without_nuisances(problem: Problem, states: States) -> tuple[Floats, Floats, Floats]:
    """Residuals with all nuisances at 0 ``(n,)``, and the slopes of the prediction by (θ, ln k) ``(n, p)`` and by each
    nuisance ``(n, m)``. One row."""
    jacobian, residual = full_jacobian(problem, states)[0], states.all_residuals[0]
    if problem.nuisances is None:
        return residual, jacobian, np.zeros((len(residual), 0))
    sd = problem.nuisances.sd
    jacobian = jacobian[: -len(sd)]
    shift = jacobian[:, -len(sd) :]
    return residual[: len(jacobian)] + shift @ problem.shared(states)[0], jacobian[:, : -len(sd)], shift


def cell_jacobian(problem: Problem, states: States, *, switches: bool = False) -> Floats:
    """d(whitened prediction)/d(θ, ln k), ``(rows, cells, 4, parameters + 1)``, see ``CellMeans.jacobian``."""
    moved = problem.moved(problem.shared(states))
    at = states.theta, states.ln_k, states.slope, moved
    return problem.cell_means.jacobian(*at, states.footing, states.whiten, switches=switches)


def slope_by_ln_k(problem: Problem, states: States) -> Floats:
    """d(cell mean)/d ln k ``(cells, 4)``. One row.

    Cells that walk or swim by chance have it too: they must not determine a level's k without the scatter of batches.
    """
    white = cell_jacobian(problem, states)[0][..., -1]
    return np.asarray(np.einsum("cij,cj->ci", np.linalg.inv(states.whiten[0]), white))


def readings_jacobian(problem: Problem, states: States) -> Floats:
    """d(whitened model of the readings)/d(θ, ln k of a level), ``(rows, readings, θ + levels)``."""
    rows, count = states.theta.shape
    readings = problem.cells.pressed
    if readings is None:
        return np.zeros((rows, 0, count + states.ln_k.shape[1]))
    step = parameter_steps(states.theta)
    # Blocks: each parameter moved, then ln k, then nothing.
    theta, ln_k, slope = (
        np.repeat(part[None], count + 2, axis=0) for part in (states.theta, states.ln_k, states.slope)
    )
    theta[np.arange(count), :, np.arange(count)] += step.T
    ln_k[count] += STEP
    *moved, here = problem.missed_forces(theta, ln_k, slope)
    steps = np.concatenate([step.T, np.full((1, rows), STEP)])
    each = (here - np.array(moved)) / steps[..., None]
    found = np.zeros((rows, len(readings), count + ln_k.shape[-1]))
    found[..., :count] = np.moveaxis(each[:count], 0, -1)
    found[:, np.arange(len(readings)), count + readings.level] = each[count]
    return np.asarray(readings.whiten @ found)


def tangent_basis(problem: Problem, states: States) -> Floats:
    """Orthonormal columns ``(values, rank)`` that span the residuals a fit's unknowns can absorb."""
    basis, singular, _ = np.linalg.svd(full_jacobian(problem, states)[0], full_matrices=False)
    return np.asarray(basis[:, singular > 1e-9 * singular[0]])


def project_out(values: Floats, basis: Floats) -> Floats:
    """``values (n, ...)`` with their component in the span of the basis removed."""
    return np.asarray(values - basis @ (basis.T @ values))
