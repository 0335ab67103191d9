"""Leave-one-out cross-validation: every cell predicted by a fit to all the others.

Where a batch consists of whole cells, for example one frequency a day, its cells share the batch's offset. None of them
says anything about another batch, so they are left out together.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.global_minimum import FIRST_ITERATIONS, HOPELESS
from sandbot_model.fitting.goodness import rms
from sandbot_model.fitting.levenberg_marquardt import bounds, descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.physics.observables import Observable

K_PRIOR = 0.03
"""Relative prior uncertainty of a level's k, from the neighbouring levels."""
FAR = 2.0
"""Change of a prediction, in standard errors of the cell mean, beyond which the linear step is not trusted."""
CV_MOST = 100.0
"""Most that a single cell adds to the deviance: no set is rejected for a cell that the others cannot predict."""


@dataclass(frozen=True)
class CrossValidation:
    """How well every cell is predicted by a fit to all the others."""

    rmse: Mapping[str, float]
    """Of each observable [SI], rms over the trials of the cells that are scored (see ``leave_one_out``)."""
    cells: int
    """Number of cells scored."""
    deviance: float
    """Deviance of all cells, each predicted by the others, limited to ``CV_MOST`` a cell."""


class LeaveOneOut(NamedTuple):
    """Cells predicted by the others: measured minus predicted ``(cells, 4)``, which are scored ``(cells,)``."""

    residual: Floats
    scored: Bools
    deviance: float


def cross_validation(problem: Problem, state: States, jacobian: Floats) -> CrossValidation:
    """A summary of ``leave_one_out``: the rms out of sample [SI], the number of cells scored, the deviance."""
    found = leave_one_out(problem, state, jacobian)
    scored = np.where(found.scored[:, None], found.residual, np.nan)
    return CrossValidation(rms(problem.cells, scored), int(found.scored.sum()), found.deviance)


def leave_one_out(problem: Problem, state: States, jacobian: Floats) -> LeaveOneOut:
    """Predict each cell with the parameters fitted to the others; ``jacobian (residuals, unknowns)``: of the fit.

    The parameters move by one linear step (see ``_linear_step``) and the model itself is evaluated there; a cell whose
    prediction moves far is fitted again without it. A cell is scored only if the other cells predict its speed at least
    as precisely as its own replicates measure it, and if leaving it out does not change whether it walks.
    """
    theta, ln_k, shared, speed_sd = _linear_step(problem, state, jacobian)
    precise = speed_sd < np.sqrt(problem.covariance[:, Observable.speed, Observable.speed])
    scored = precise & problem.away_from_switch(problem.widening(state.covariance[0]))
    found = problem.cell_by_cell(theta, ln_k, state.slope, shared)
    far = np.flatnonzero(scored & _moved_far(problem, state, found.predicted))
    if len(far):
        for cell in far:
            without = _fit_without(problem, int(cell), state, theta[cell], ln_k[cell])
            theta[cell], ln_k[cell], shared[cell] = without
        found = problem.cell_by_cell(theta, ln_k, state.slope, shared)
    scored &= problem.away_from_switch(found.widening)
    scored &= found.walks == (state.footing.walking[0].mean(axis=1) > 0.5)
    residual = np.where(problem.measured, problem.cells.mean - found.predicted, np.nan)
    return LeaveOneOut(residual, scored, float(np.minimum(found.deviance, CV_MOST).sum()))


def _linear_step(problem: Problem, state: States, jacobian: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """θ ``(cells, parameters)``, ln k ``(cells, levels)``, nuisances ``(cells, nuisances)`` fitted without each cell,
    and the standard deviation of its predicted speed [m/s] ``(cells,)``.

    Removing the rows J_c, r_c of the cells left out together from the normal equations moves the minimum by
    -(JᵀJ - J_cᵀJ_c)⁻¹ J_cᵀ r_c. A prior of relative width ``K_PRIOR`` keeps k near its value where no other cell
    determines it.
    """
    count = state.theta.shape[1]
    prior = np.zeros(jacobian.shape[1])
    unknowns = count + state.ln_k.shape[1]
    prior[count:unknowns] = K_PRIOR**-2
    blocks = jacobian[: state.residual[0].size].reshape(*state.residual[0].shape, -1)
    together = left_out_with(problem.cells).astype(float)
    own = np.einsum("cip,ciq->cpq", blocks, blocks)
    normal = jacobian.T @ jacobian + np.diag(prior) - np.tensordot(together, own, axes=1)
    scale = np.sqrt(np.maximum(np.diag(jacobian.T @ jacobian) + prior, 1e-12))
    inverse = np.linalg.inv(normal / scale[:, None] / scale[None, :] + 1e-9 * np.eye(len(scale)))
    inverse = inverse / scale[:, None] / scale[None, :]
    pull = together @ np.einsum("ciq,ci->cq", blocks, state.residual[0])
    move = -np.einsum("cpq,cq->cp", inverse, pull)
    low, high = bounds(problem)
    theta = np.clip(state.theta + move[:, :count], low, high)
    ln_k = state.ln_k + np.clip(move[:, count:unknowns], -3 * K_PRIOR, 3 * K_PRIOR)
    shared = problem.shared(state) + move[:, unknowns:]
    # The first row of L turns whitened slopes into those of speed.
    slope = np.einsum("ci,cip->cp", np.linalg.inv(state.whiten[0])[:, Observable.speed, :], blocks)
    return theta, ln_k, shared, np.asarray(np.sqrt(np.einsum("cp,cpq,cq->c", slope, inverse, slope)))


def left_out_with(cells: Cells) -> Bools:
    """Which cells are left out with each ``(cells, cells)``: itself, and those of its batch if that has whole cells."""
    share = cells.batch_share
    alone = np.eye(len(cells), dtype=bool)
    if share is None:
        return alone
    whole = share * (share.max(axis=1, keepdims=True) == 1.0)
    return np.asarray(alone | (whole @ whole.T > 0.0))


def _moved_far(problem: Problem, state: States, predicted: Floats) -> Bools:
    """Cells where the linear step can't be trusted; none for a model that fits far too badly to matter."""
    move = np.abs(predicted - state.predicted[0])[:, Observable.speed]
    fits = state.deviance[0] < HOPELESS * problem.measured.sum()
    return np.asarray(fits & (move > FAR * np.sqrt(problem.covariance[:, Observable.speed, Observable.speed])))


def _fit_without(
    problem: Problem, cell: int, state: States, theta: Floats, ln_k: Floats
) -> tuple[Floats, Floats, Floats]:
    """θ, ln k and nuisances fitted without a cell and those left out with it: the better of descents from the linear
    step and from the full fit."""
    left_out = np.flatnonzero(left_out_with(problem.cells)[cell])
    fewer = problem.without(left_out)
    both = np.stack([theta, state.theta[0]]), np.stack([ln_k, state.ln_k[0]])
    begin = fewer.states(*both, state.slope, problem.bed(state))
    found = descend(fewer, begin, 2 * FIRST_ITERATIONS)
    best = int(found.deviance.argmin())
    return found.theta[best], found.ln_k[best], fewer.shared(found)[best]
