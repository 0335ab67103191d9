"""Fit a walking model with effects to cells: one k per φ level, everything else shared."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting import goodness
from sandbot_model.fitting.global_minimum import Known, Point, best_state
from sandbot_model.fitting.goodness import Estimate, Fail
from sandbot_model.fitting.leave_one_out import clear_of_switch, left_out
from sandbot_model.fitting.levenberg_marquardt import bounds, full_jacobian
from sandbot_model.fitting.likelihood import Problem, States
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.model import Model
from sandbot_model.physics.walking import KCurve, Prediction


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model. Arrays over cells have length n, the last axis is ``Observable``."""

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
        curve = KCurve(self.level_phi, k)
        inputs, params = self.fitted.inputs(theta, curve(at), omega, at, beta, curve)
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
    firm = clear_of_switch(problem, problem.widening(state.covariance[0]))
    left = left_out(problem, state, jacobian)
    rmse = goodness.rms(cells, np.where(firm[:, None], gap, np.nan))
    cv_rmse = goodness.rms(cells, np.where(left.told[:, None], left.gap, np.nan))
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
        fails=goodness.fails(cells, gap, z),
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
        lack_of_fit_p=goodness.joint_p(chi2, values - unknowns, cells),
        lack_of_fit=goodness.p_by_observable(z, problem, unknowns) | goodness.p_of_readings(state),
        at_bounds=goodness.at_bounds(problem, theta),
        implausible=goodness.implausible(model, estimates),
        fitted=model,
        problem=problem,
        state=state,
    )
