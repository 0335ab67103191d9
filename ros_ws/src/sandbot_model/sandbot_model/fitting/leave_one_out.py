"""Every cell predicted by a fit to all the others."""

from typing import NamedTuple

import numpy as np

from sandbot_model.fitting.global_minimum import FIRST_ITERATIONS, HOPELESS
from sandbot_model.fitting.levenberg_marquardt import bounds, descend
from sandbot_model.fitting.likelihood import Problem, States
from sandbot_model.physics.arrays import Array, Bool
from sandbot_model.physics.observables import Observable

K_PRIOR = 0.03
"""How well k is known from neighbouring levels, relative."""
EDGE = 1.25
"""A cell whose mean scatters so much wider by chance of walking or swimming than by pure error is on the edge."""
FAR = 2.0
"""Standard errors of a cell mean beyond which leaving it out is more than a linear step."""
CV_MOST = 100.0
"""Most that one cell counts in ``cv_deviance``: what only it could tell is not held against a set without end."""


class LeftOut(NamedTuple):
    """Cells predicted by the others: measured minus predicted ``(cells, 4)`` and whether they can tell ``(cells,)``."""

    gap: Array
    told: Bool
    deviance: float


def left_out(problem: Problem, state: States, jacobian: Array) -> LeftOut:
    """Each cell by the parameters that fit the others.

    Taking a cell's rows J_c, r_c out of the normal equations moves the minimum by -(JᵀJ - J_cᵀJ_c)⁻¹ J_cᵀ r_c; the
    model itself is then evaluated there. A cell whose prediction moves far is fitted again without it. Where the cell
    left out alone tells its level's k, k is taken as known to ``K_PRIOR`` from the levels beside it. A
    cell is told if the others know it as well as its own replicates do, and whether it walks does not hang on itself.
    """
    count, level = state.theta.shape[1], problem.cells.level
    prior = np.zeros(jacobian.shape[1])
    prior[count:] = K_PRIOR**-2
    blocks = jacobian[: 4 * len(level)].reshape(len(level), 4, -1)
    normal = jacobian.T @ jacobian + np.diag(prior) - np.einsum("cip,ciq->cpq", blocks, blocks)
    scale = np.sqrt(np.maximum(np.diag(jacobian.T @ jacobian) + prior, 1e-12))
    inverse = np.linalg.inv(normal / scale[:, None] / scale[None, :] + 1e-9 * np.eye(len(scale)))
    inverse = inverse / scale[:, None] / scale[None, :]
    move = -np.einsum("cpq,ciq,ci->cp", inverse, blocks, state.residual[0])
    low, high = bounds(problem)
    theta = np.clip(state.theta + move[:, :count], low, high)
    ln_k = state.ln_k + np.clip(move[:, count:], -3 * K_PRIOR, 3 * K_PRIOR)
    # The first row of L turns whitened slopes into those of speed.
    slope = np.einsum("ci,cip->cp", np.linalg.inv(state.whiten[0])[:, Observable.speed, :], blocks)
    unsure = np.sqrt(np.einsum("cp,cpq,cq->c", slope, inverse, slope))
    told = (unsure < np.sqrt(problem.covariance[:, Observable.speed, Observable.speed])) & clear_of_switch(
        problem, problem.widening(state.covariance[0])
    )
    found = problem.each_by_its_own(theta, ln_k, state.slope)
    far = np.flatnonzero(told & _moved_far(problem, state, found.predicted))
    if len(far):
        for cell in far:
            theta[cell], ln_k[cell] = _fit_without(problem, int(cell), state, theta[cell], ln_k[cell])
        found = problem.each_by_its_own(theta, ln_k, state.slope)
    told &= clear_of_switch(problem, found.widening) & (found.walks == (state.footing.walking[0].mean(axis=1) > 0.5))
    gap = np.where(problem.measured, problem.cells.mean - found.predicted, np.nan)
    return LeftOut(gap, told, float(np.minimum(found.deviance, CV_MOST).sum()))


def _moved_far(problem: Problem, state: States, predicted: Array) -> Bool:
    """Cells where a linear step can't be trusted; none for a model that is far off anyway."""
    move = np.abs(predicted - state.predicted[0])[:, Observable.speed]
    fits = state.deviance[0] < HOPELESS * problem.measured.sum()
    return np.asarray(fits & (move > FAR * np.sqrt(problem.covariance[:, Observable.speed, Observable.speed])))


def _fit_without(problem: Problem, cell: int, state: States, theta: Array, ln_k: Array) -> tuple[Array, Array]:
    """θ and ln k that fit all cells but one, the better of what is found from the linear step and from the fit."""
    fewer = Problem(problem.model, problem.cells.without(cell))
    begin = fewer.states(np.stack([theta, state.theta[0]]), np.stack([ln_k, state.ln_k[0]]), state.slope)
    found = descend(fewer, begin, 2 * FIRST_ITERATIONS)
    best = int(found.deviance.argmin())
    return found.theta[best], found.ln_k[best]


def clear_of_switch(problem: Problem, widening: Array) -> Bool:
    """Cells where neither the replicates nor the model walk or swim by chance.

    A model that has most of them on the edge does not know what it says, and is scored on all.
    """
    firm = widening < EDGE
    return np.asarray(~problem.cells.own_scatter & (firm | (firm.mean() < 0.5)))
