"""Fit a walking model with effects to cells: one k per φ level, everything else shared."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import f as f_distribution

from sandbot_model.cells import OBSERVABLES, Cells
from sandbot_model.chain import Array, Bool
from sandbot_model.descent import bounds, descend, full_jacobian
from sandbot_model.minimise import FIRST_ITERATIONS, HOPELESS, Known, Point, best_state
from sandbot_model.model import Model
from sandbot_model.problem import Problem, States
from sandbot_model.walking import Inputs, KCurve, Prediction

FAIL_Z = 3.0
"""Cell means missed by more standard errors than this are listed as failing."""
AT_BOUND = 1e-3
PLAUSIBLE_SIGMAS = 3.0
K_PRIOR = 0.03
"""How well k is known from neighbouring levels, relative."""
EDGE = 1.25
"""A cell whose mean scatters so much wider by chance of walking or swimming than by pure error is on the edge."""
FAR = 2.0
"""Standard errors of a cell mean beyond which leaving it out is more than a linear step."""
CV_MOST = 100.0
"""Most that one cell counts in ``cv_deviance``: what only it could tell is not held against a set without end."""


class Estimate(NamedTuple):
    """A fitted value with its standard error (NaN where it can't be told)."""

    value: float
    stderr: float


@dataclass(frozen=True)
class Fail:
    """One cell mean the model misses: residual = measured - model, z = residual over its standard error."""

    observable: str
    phi: float
    omega_rad_s: float
    residual: float
    z: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model. Arrays over cells have length n, the last axis is ``cells.OBSERVABLES``."""

    model: str
    effects: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    level_phi: Array
    k_n_per_m: Array
    k_stderr_n_per_m: Array
    covariance: Array = field(repr=False)
    """Of the shared parameters, in the order of ``parameters``, and the levels' ln k; what can't be told is 0."""
    cells: Cells
    predicted: Array
    residual_z: Array
    fails: tuple[Fail, ...]
    rmse_m_s: float
    """Speed: rms over trials of measured minus model, so that a perfect model reaches the noise floor. Cells where
    the robot walks or swims by chance, in the replicates or by the model, have no value to be near and are not in."""
    cv_rmse_m_s: float
    """The same with every cell predicted by a fit to all others, where those can tell it (``cv_cells``)."""
    cv_deviance: float
    """Deviance of all cells, each predicted by a fit to all others, as one score of how well the set foretells."""
    cv_cells: int
    """Cells that ``cv_rmse_m_s`` is made of."""
    rmse: Mapping[str, float]
    cv_rmse: Mapping[str, float]
    chi2: float
    deviance: float
    dof: int
    bic: float
    lack_of_fit_p: float
    """F test of the cell means against pure error, all observables together; NaN without replicates."""
    lack_of_fit: Mapping[str, float]
    at_bounds: tuple[str, ...]
    """Parameters pressed against the end of their search range."""
    implausible: tuple[str, ...]
    """Parameters more than three standard errors outside their plausible range."""
    fitted: Model = field(repr=False)
    problem: Problem = field(repr=False)
    state: States = field(repr=False)

    @property
    def known(self) -> Known:
        """What a larger model may start from."""
        values = {name: estimate.value for name, estimate in self.parameters.items()}
        return Known(self.k_n_per_m, values, self.deviance)

    def predict(self, phi: ArrayLike, omega: ArrayLike, slow_phase_ratio: ArrayLike | None = None) -> Prediction:
        """The observables at other conditions; k is interpolated between levels and held beyond them.

        ``slow_phase_ratio`` is β of the gait, by default that of the trials.
        """
        return self._predict(self.state.theta[0], self.state.ln_k[0], phi, omega, slow_phase_ratio)

    def uncertainty(self, phi: ArrayLike, omega: ArrayLike, slow_phase_ratio: ArrayLike | None = None) -> Array:
        """Standard deviation ``(..., 4)`` of what ``predict`` says, from not knowing θ and k exactly.

        Along each principal axis of the parameters' covariance the prediction is made one standard deviation to
        either side, √Σ_i ((y_i+ - y_i-)/2)²: beside a switch, where a slope would say nothing, this sees the switch.
        """
        found = self._spread(lambda theta, k: self._predict(theta, k, phi, omega, slow_phase_ratio).observables)
        shape = np.broadcast_shapes(
            np.shape(phi), np.shape(omega), () if slow_phase_ratio is None else np.shape(slow_phase_ratio)
        )
        return np.asarray(np.broadcast_to(found, (*shape, 4)))

    def press(self, phi: Array, depth_m: Array) -> tuple[Array, Array]:
        """Force [N] on a leg pressed into virgin ground (see ``penetration``) and its standard deviation, ``(n,)``."""

        def force(theta: Array, ln_k: Array) -> Array:
            return self.problem.press(theta, np.interp(phi, self.level_phi, np.exp(ln_k)), phi, depth_m)

        return force(self.state.theta[0], self.state.ln_k[0]), self._spread(force)

    def _spread(self, predict: Callable[[Array, Array], Array]) -> Array:
        low, high = bounds(self.problem)
        count = len(low)
        here = np.concatenate([self.state.theta[0], self.state.ln_k[0]])
        variance, axes = np.linalg.eigh(self.covariance)
        total = np.zeros(())
        for size, axis in zip(np.sqrt(np.maximum(variance, 0.0)), axes.T, strict=True):
            if size > 0.0:
                ends = [here + sign * size * axis for sign in (-1.0, 1.0)]
                sides = [predict(np.clip(end[:count], low, high), end[count:]) for end in ends]
                total = total + (0.5 * (sides[1] - sides[0])) ** 2
        return np.asarray(np.sqrt(total))

    def _predict(
        self, theta: Array, ln_k: Array, phi: ArrayLike, omega: ArrayLike, slow_phase_ratio: ArrayLike | None
    ) -> Prediction:
        at, k = np.asarray(phi, dtype=float), np.exp(ln_k)
        cells = self.cells
        beta = cells.slow_phase_ratio[0] if slow_phase_ratio is None else slow_phase_ratio
        delta_t, v_swim, params = self.fitted.arguments(theta)
        inputs = Inputs(
            k_n_per_m=np.interp(at, self.level_phi, k),
            omega_rad_s=omega,
            delta_t_s=delta_t,
            phi=at,
            v_swim_m_s=v_swim,
            slow_phase_ratio=beta,
            k_of_phi=KCurve(self.level_phi, k),
        )
        shape = np.broadcast_shapes(np.shape(at), np.shape(omega), np.shape(beta))
        found = self.fitted.walker.predict(inputs, params)
        return Prediction(*(np.broadcast_to(values, shape) for values in vars(found).values()))


def fit(model: Model, cells: Cells, near: Known | None = None) -> Fit:
    """The global minimum of the deviance over θ and one k per level.

    ``near`` is what a smaller model has found: its k(φ) is where the search begins, its parameters are tried as a
    start.
    """
    problem = Problem(model, cells)
    return summary(problem, best_state(problem, near))


def fitted_at(model: Model, cells: Cells, point: Point) -> Fit:
    """The fit whose minimum is known already."""
    problem = Problem(model, cells)
    return summary(problem, problem.states(point.theta[None], point.ln_k[None], point.slope[None]))


def summary(problem: Problem, state: States) -> Fit:
    """Standard errors, tests and errors of a fitted state (one row)."""
    cells, model = problem.cells, problem.model
    jacobian = full_jacobian(problem, state)[0]
    normal = jacobian.T @ jacobian
    covariance = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    untold = np.diag(normal) < 1e-12
    stderr[untold] = np.nan
    covariance[untold] = covariance[:, untold] = 0.0
    theta, k, predicted = state.theta[0], np.exp(state.ln_k[0]), state.predicted[0]
    values, unknowns = int(problem.measured.sum()) + state.pressed.shape[1], len(theta) + len(k)
    gap = np.where(problem.measured, cells.mean - predicted, np.nan)
    z = gap / np.sqrt(np.diagonal(state.covariance[0], axis1=1, axis2=2))
    chi2, deviance = float(np.sum(state.missed**2)), float(state.deviance[0])
    firm = _firm(problem, problem.widening(state.covariance[0]))
    left = left_out(problem, state, jacobian)
    rmse = _rms(cells, np.where(firm[:, None], gap, np.nan))
    cv_rmse = _rms(cells, np.where(left.told[:, None], left.gap, np.nan))
    estimates = {
        name: Estimate(float(value), float(error))
        for name, value, error in zip(model.names, theta, stderr, strict=False)
    }
    return Fit(
        model=model.base,
        effects=model.identifiers,
        parameters=estimates,
        level_phi=cells.level_phi,
        k_n_per_m=k,
        k_stderr_n_per_m=k * stderr[len(theta) :],
        covariance=covariance,
        cells=cells,
        predicted=predicted,
        residual_z=z,
        fails=_fails(cells, gap, z),
        rmse_m_s=rmse["speed"],
        cv_rmse_m_s=cv_rmse["speed"],
        cv_deviance=left.deviance,
        cv_cells=int(left.told.sum()),
        rmse=rmse,
        cv_rmse=cv_rmse,
        chi2=chi2,
        deviance=deviance,
        dof=values - unknowns,
        bic=deviance + unknowns * float(np.log(values)),
        lack_of_fit_p=_joint_p(chi2, values - unknowns, cells),
        lack_of_fit=_p_by_observable(z, problem, unknowns) | _p_of_readings(state),
        at_bounds=_at_bounds(problem, theta),
        implausible=_implausible(model, estimates),
        fitted=model,
        problem=problem,
        state=state,
    )


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
    slope = np.einsum("ci,cip->cp", np.linalg.inv(state.whiten[0])[:, 0, :], blocks)
    unsure = np.sqrt(np.einsum("cp,cpq,cq->c", slope, inverse, slope))
    told = (unsure < np.sqrt(problem.covariance[:, 0, 0])) & _firm(problem, problem.widening(state.covariance[0]))
    found = problem.each_by_its_own(theta, ln_k, state.slope)
    far = np.flatnonzero(told & _moved_far(problem, state, found.predicted))
    if len(far):
        for cell in far:
            theta[cell], ln_k[cell] = _fit_without(problem, int(cell), state, theta[cell], ln_k[cell])
        found = problem.each_by_its_own(theta, ln_k, state.slope)
    told &= _firm(problem, found.widening) & (found.walks == (state.footing.walking[0].mean(axis=1) > 0.5))
    gap = np.where(problem.measured, problem.cells.mean - found.predicted, np.nan)
    return LeftOut(gap, told, float(np.minimum(found.deviance, CV_MOST).sum()))


def _moved_far(problem: Problem, state: States, predicted: Array) -> Bool:
    """Cells where a linear step can't be trusted; none for a model that is far off anyway."""
    move = np.abs(predicted - state.predicted[0])[:, 0]
    fits = state.deviance[0] < HOPELESS * problem.measured.sum()
    return np.asarray(fits & (move > FAR * np.sqrt(problem.covariance[:, 0, 0])))


def _fit_without(problem: Problem, cell: int, state: States, theta: Array, ln_k: Array) -> tuple[Array, Array]:
    """θ and ln k that fit all cells but one, the better of what is found from the linear step and from the fit."""
    fewer = Problem(problem.model, problem.cells.without(cell))
    begin = fewer.states(np.stack([theta, state.theta[0]]), np.stack([ln_k, state.ln_k[0]]), state.slope)
    found = descend(fewer, begin, 2 * FIRST_ITERATIONS)
    best = int(found.deviance.argmin())
    return found.theta[best], found.ln_k[best]


def _firm(problem: Problem, widening: Array) -> Bool:
    """Cells where neither the replicates nor the model walk or swim by chance.

    A model that has most of them on the edge does not know what it says, and is scored on all.
    """
    firm = widening < EDGE
    return np.asarray(~problem.cells.own_scatter & (firm | (firm.mean() < 0.5)))


def _rms(cells: Cells, gap: Array) -> dict[str, float]:
    """Rms over trials: the gap of the cell mean and the scatter about it."""
    n = np.where(np.isfinite(gap), cells.n, 0)
    within = np.where(n > 1, (n - 1) * np.nan_to_num(cells.sd) ** 2, 0.0).sum(axis=0)
    between = (n * np.nan_to_num(gap) ** 2).sum(axis=0)
    total = n.sum(axis=0)
    return {
        name: float(np.sqrt((within[i] + between[i]) / total[i])) if total[i] else float("nan")
        for i, name in enumerate(OBSERVABLES)
    }


def _fails(cells: Cells, gap: Array, z: Array) -> tuple[Fail, ...]:
    rows = np.argwhere(np.nan_to_num(np.abs(z)) > FAIL_Z)
    rows = rows[np.argsort(-np.abs(z[rows[:, 0], rows[:, 1]]))]
    return tuple(
        Fail(OBSERVABLES[o], float(cells.phi[c]), float(cells.omega[c]), float(gap[c, o]), float(z[c, o]))
        for c, o in rows
    )


def _joint_p(chi2: float, dof: int, cells: Cells) -> float:
    error_dof = int(cells.pure_error_dof.max())
    if dof < 1 or error_dof < 1:
        return float("nan")
    return float(f_distribution.sf(chi2 / dof, dof, error_dof))


def _p_by_observable(z: Array, problem: Problem, unknowns: int) -> dict[str, float]:
    """Each observable by itself; it answers for its share of the fitted unknowns."""
    measured = problem.measured.sum(axis=0)
    share = unknowns / max(int(measured.sum()), 1)
    found = {}
    for index, name in enumerate(OBSERVABLES):
        dof = measured[index] * (1 - share)
        error_dof = problem.cells.pure_error_dof[index]
        if measured[index]:
            ratio = np.nansum(z[:, index] ** 2) / max(dof, 1e-9)
            found[name] = float(f_distribution.sf(ratio, dof, error_dof)) if dof > 0 and error_dof else float("nan")
    return found


def _p_of_readings(state: States) -> dict[str, float]:
    """A penetrometer's readings come with their own standard deviation."""
    count = state.pressed.shape[1]
    return {"penetration": float(chi2_distribution.sf(np.sum(state.pressed**2), count))} if count else {}


def _at_bounds(problem: Problem, theta: Array) -> tuple[str, ...]:
    low, high = bounds(problem)
    edge = AT_BOUND * (high - low)
    pressed = (theta <= low + edge) | (theta >= high - edge)
    return tuple(name for name, at in zip(problem.model.names, pressed, strict=True) if at)


def _implausible(model: Model, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
    found = []
    for name, one in zip(model.names, model.parameters, strict=True):
        value, error = estimates[name]
        margin = PLAUSIBLE_SIGMAS * (error if np.isfinite(error) else 0.0)
        if value < one.low - margin or value > one.high + margin:
            found.append(name)
    return tuple(found)
