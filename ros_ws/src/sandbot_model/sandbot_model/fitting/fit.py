"""Fit a walking model with effects to cells: one k per φ level, everything else shared."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting import goodness
from sandbot_model.fitting.global_minimum import Point, WarmStart, solve
from sandbot_model.fitting.goodness import Estimate, Fail, Goodness
from sandbot_model.fitting.leave_one_out import CrossValidation, cross_validation
from sandbot_model.fitting.levenberg_marquardt import bounds, full_jacobian
from sandbot_model.fitting.likelihood import Problem, States
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.plain import data_frame, number, plain
from sandbot_model.fitting.text import cm_s, html_table, probability, with_error
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.walking import KCurve, Prediction

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted model. Arrays over cells have length n, the last axis is ``Observable``.

    What follows from these fields is computed when it is asked for, and is not pickled.
    """

    model: Model
    cells: Cells
    point: Point
    stderr: Array
    """Standard errors of the shared parameters, then of every level's ln k; NaN where the data do not determine one."""
    covariance: Array
    """Covariance of the same unknowns; 0 where the data do not determine one."""
    goodness: Goodness
    cross_validation: CrossValidation
    nuisances: Nuisances | None = None
    """What trials share, adjusted with the rest; ``shared`` is what was found."""
    shared: tuple[Estimate, ...] = ()

    @property
    def effects(self) -> tuple[str, ...]:
        """Identifiers of the effects on top of the base model."""
        return self.model.identifiers

    @cached_property
    def parameters(self) -> Mapping[str, Estimate]:
        """The shared parameters."""
        named = zip(self.model.names, self.point.theta, self.stderr, strict=False)
        return {name: Estimate(float(value), float(error)) for name, value, error in named}

    @property
    def level_phi(self) -> Array:
        """Volume fraction of every level."""
        return self.cells.level_phi

    @cached_property
    def k_n_per_m(self) -> Array:
        """Stiffness of the ground at every level."""
        return np.asarray(np.exp(self.point.ln_k))

    @property
    def k_stderr_n_per_m(self) -> Array:
        """Its standard error."""
        return self.k_n_per_m * self.stderr[len(self.point.theta) : len(self.point.theta) + len(self.point.ln_k)]

    @property
    def deviance(self) -> float:
        """See ``Goodness``."""
        return self.goodness.deviance

    @property
    def bic(self) -> float:
        """See ``Goodness``."""
        return self.goodness.bic

    @property
    def lack_of_fit_p(self) -> float:
        """See ``Goodness``."""
        return self.goodness.lack_of_fit_p

    @property
    def rmse_m_s(self) -> float:
        """Error of mean speed in sample."""
        return self.goodness.rmse["speed"]

    @property
    def cv_rmse_m_s(self) -> float:
        """Error of mean speed out of sample."""
        return self.cross_validation.rmse["speed"]

    @cached_property
    def problem(self) -> Problem:
        """The likelihood that was maximised."""
        return Problem(self.model, self.cells, self.nuisances)

    @cached_property
    def state(self) -> States:
        """The likelihood at the fitted parameters, one row."""
        return _state(self.problem, self.point)

    @property
    def predicted(self) -> Array:
        """Cell means by the model ``(n, 4)``."""
        return np.asarray(self.state.predicted[0])

    @cached_property
    def residual_z(self) -> Array:
        """Measured minus model in standard errors ``(n, 4)``; NaN where not measured."""
        return goodness.residual_z(self.problem, self.state)

    @cached_property
    def fails(self) -> tuple[Fail, ...]:
        """The cell means that are missed, the worst first."""
        return goodness.fails(self.cells, goodness.residual(self.problem, self.state), self.residual_z)

    @cached_property
    def at_bounds(self) -> tuple[str, ...]:
        """Parameters pressed against the end of their search range."""
        return goodness.at_bounds(self.problem, self.point.theta)

    @cached_property
    def implausible(self) -> tuple[str, ...]:
        """Parameters more than three standard errors outside their plausible range."""
        return goodness.implausible(self.model, self.parameters)

    @property
    def warm_start(self) -> WarmStart:
        """What a larger model may start from."""
        values = {name: estimate.value for name, estimate in self.parameters.items()}
        return WarmStart(self.k_n_per_m, values, self.deviance)

    def predict(self, phi: ArrayLike, omega: ArrayLike, slow_phase_ratio: ArrayLike | None = None) -> Prediction:
        """The observables at other conditions; k is interpolated between levels and held beyond them.

        ``slow_phase_ratio`` is β of the gait, by default that of the trials.
        """
        return self._predict(self.point.theta, self.point.ln_k, phi, omega, slow_phase_ratio)

    def uncertainty(self, phi: ArrayLike, omega: ArrayLike, slow_phase_ratio: ArrayLike | None = None) -> Array:
        """Standard deviation ``(..., 4)`` of what ``predict`` says, because θ and k are not known exactly.

        Along each principal axis of the parameters' covariance the prediction is made one standard deviation to
        either side, √Σ_i ((y_i+ - y_i-)/2)²: beside a switch, where a derivative would show nothing, this shows the
        switch.
        """
        found = self._spread(lambda theta, k: self._predict(theta, k, phi, omega, slow_phase_ratio).observables)
        shape = np.broadcast_shapes(
            np.shape(phi), np.shape(omega), () if slow_phase_ratio is None else np.shape(slow_phase_ratio)
        )
        return np.asarray(np.broadcast_to(found, (*shape, 4)))

    def press(self, phi: Array, depth_m: Array) -> tuple[Array, Array]:
        """Force [N] on a leg pressed into virgin ground (see ``penetrometer``) and its standard deviation, ``(n,)``."""

        def force(theta: Array, ln_k: Array) -> Array:
            return self.problem.press(theta, np.interp(phi, self.level_phi, np.exp(ln_k)), phi, depth_m)

        return force(self.point.theta, self.point.ln_k), self._spread(force)

    def to_dict(self) -> dict[str, Any]:
        """Plain data: one step of the JSON of ``compare`` and ``discover``."""
        fit, cv = self.goodness, self.cross_validation
        return {
            "effects": list(self.effects),
            "rmse_m_s": number(self.rmse_m_s),
            "cv_rmse_m_s": number(self.cv_rmse_m_s),
            "rmse": {name: number(value) for name, value in fit.rmse.items()},
            "cv_rmse": {name: number(value) for name, value in cv.rmse.items()},
            "cv_cells": cv.cells,
            "cv_deviance": number(cv.deviance),
            "chi2": number(fit.chi2),
            "dof": fit.dof,
            "lack_of_fit_p": number(fit.lack_of_fit_p),
            "lack_of_fit": {name: number(value) for name, value in fit.lack_of_fit.items()},
            "parameters": {
                name: {"value": number(value), "stderr": number(stderr)}
                for name, (value, stderr) in self.parameters.items()
            },
            "k_n_per_m": [
                {"phi": number(phi), "value": number(k), "stderr": number(stderr)}
                for phi, k, stderr in zip(self.level_phi, self.k_n_per_m, self.k_stderr_n_per_m, strict=True)
            ],
            "at_bounds": list(self.at_bounds),
            "implausible": list(self.implausible),
            "fails": [plain(fail) for fail in self.fails],
        }

    def nuisances_to_dict(self) -> list[dict[str, Any]]:
        """What trials share as plain data; empty where nothing was taken for granted.

        Batches are one entry: how many there are, and the rms of their offsets.
        """
        if self.nuisances is None:
            return []
        found: dict[str, dict[str, Any]] = {}
        for name, sd, (value, stderr) in zip(
            self.nuisances.names, self.nuisances.sd.tolist(), self.shared, strict=True
        ):
            entry = {"name": name, "prior_sd": sd, "count": 1, "value": number(value), "stderr": number(stderr)}
            if name in found:
                count = found[name]["count"]
                rms = float(np.sqrt((count * found[name]["value"] ** 2 + value**2) / (count + 1)))
                entry |= {"count": count + 1, "value": rms, "stderr": None}
            found[name] = entry
        return list(found.values())

    def to_frame(self) -> "DataFrame":
        """Parameters and k(φ) [SI]: one row each, with value, standard error and unit.

        Raises InputError where pandas is not installed.
        """
        rows = [
            {"parameter": name, "phi": np.nan, "value": value, "stderr": stderr, "unit": parameter.unit}
            for (name, (value, stderr)), parameter in zip(self.parameters.items(), self.model.parameters, strict=True)
        ]
        rows += [
            {"parameter": "k_n_per_m", "phi": phi, "value": k, "stderr": stderr, "unit": "N/m"}
            for phi, k, stderr in zip(self.level_phi, self.k_n_per_m, self.k_stderr_n_per_m, strict=True)
        ]
        return data_frame(rows).set_index("parameter")

    def residuals_frame(self) -> "DataFrame":
        """Measured beside predicted [SI]: one row for each observable measured in a cell.

        Raises InputError where pandas is not installed.
        """
        cells = self.cells
        rows = [
            {
                "phi": cells.phi[cell],
                "omega_rad_s": cells.omega[cell],
                "gait": cells.gait[cell],
                "observable": NAMES[observable],
                "replicates": cells.n[cell, observable],
                "measured": cells.mean[cell, observable],
                "predicted": self.predicted[cell, observable],
                "residual": cells.mean[cell, observable] - self.predicted[cell, observable],
                "z": self.residual_z[cell, observable],
            }
            for cell, observable in np.argwhere(self.problem.measured)
        ]
        return data_frame(rows)

    def __repr__(self) -> str:
        cells = self.cells
        lines = [
            f"{self.name}: fitted to {cells.trials} trials in {len(cells)} conditions",
            *(f"  {name:<28}{estimate}" for name, estimate in self.estimates()),
            f"  {'error of mean speed':<28}{cm_s(self.rmse_m_s)} in sample, {cm_s(self.cv_rmse_m_s)} out of sample",
            f"  {'lack of fit p':<28}{probability(self.lack_of_fit_p)}",
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        errors = [("error of mean speed, in sample", cm_s(self.rmse_m_s)), ("out of sample", cm_s(self.cv_rmse_m_s))]
        tests = [("lack of fit p", probability(self.lack_of_fit_p))]
        return html_table([(self.name, "value"), *self.estimates(), *errors, *tests])

    @property
    def name(self) -> str:
        """The model in words: ``simple model + leg_slip``."""
        return " + ".join((f"{self.model.base} model", *self.effects))

    def estimates(self) -> list[tuple[str, str]]:
        """Each parameter and k(φ) with its value as text, rounded to its error."""
        units = ["" if parameter.unit == "1" else f" {parameter.unit}" for parameter in self.model.parameters]
        shared = [
            (name, with_error(*estimate) + unit)
            for (name, estimate), unit in zip(self.parameters.items(), units, strict=True)
        ]
        levels = [
            (f"k at φ {phi:.3f}", f"{with_error(k, stderr)} N/m")
            for phi, k, stderr in zip(self.level_phi, self.k_n_per_m, self.k_stderr_n_per_m, strict=True)
        ]
        return [*shared, *levels]

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def _spread(self, predict: Callable[[Array, Array], Array]) -> Array:
        low, high = bounds(self.problem)
        count = len(low)
        here = np.concatenate([self.point.theta, self.point.ln_k])
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
        inputs, params = self.model.inputs(theta, curve(at), omega, at, beta, curve)
        shape = np.broadcast_shapes(np.shape(at), np.shape(omega), np.shape(beta))
        found = self.model.walker.predict(inputs, params)
        return Prediction(*(np.broadcast_to(values, shape) for values in vars(found).values()))


def fit(model: Model, cells: Cells, near: WarmStart | None = None) -> Fit:
    """The global minimum of the deviance over θ and one k per level.

    ``near`` is what a smaller model has found: its k(φ) is where the search begins, its parameters are tried as a
    start.
    """
    return fitted_at(model, cells, solve((model, cells, near, False)))


def fitted_at(model: Model, cells: Cells, point: Point, nuisances: Nuisances | None = None) -> Fit:
    """The fit at a minimum found before, with its standard errors, tests and errors."""
    problem = Problem(model, cells, nuisances)
    state = _state(problem, point)
    jacobian = full_jacobian(problem, state)[0]
    stderr, covariance = _standard_errors(jacobian)
    own = len(point.theta) + len(point.ln_k)
    values = () if nuisances is None else (-state.shared[0] * nuisances.sd).tolist()
    return Fit(
        model=model,
        cells=cells,
        point=point,
        stderr=stderr[:own],
        covariance=covariance[:own, :own],
        goodness=goodness.goodness(problem, state),
        cross_validation=cross_validation(problem, state, jacobian),
        nuisances=nuisances,
        shared=tuple(Estimate(value, error) for value, error in zip(values, stderr[own:].tolist(), strict=True)),
    )


def _state(problem: Problem, point: Point) -> States:
    return problem.states(point.theta[None], point.ln_k[None], point.slope[None])


def _standard_errors(jacobian: Array) -> tuple[Array, Array]:
    """Standard errors and covariance of all unknowns; NaN and 0 for those that the data do not determine."""
    normal = jacobian.T @ jacobian
    covariance = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    undetermined = np.diag(normal) < 1e-12
    stderr[undetermined] = np.nan
    covariance[undetermined] = covariance[:, undetermined] = 0.0
    return np.asarray(stderr), np.asarray(covariance)
