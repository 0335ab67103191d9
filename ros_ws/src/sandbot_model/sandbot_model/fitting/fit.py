"""Fit a walking model with effects to cells: one k per φ level, everything else shared."""

import math
import textwrap
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sandbot_common.data_frame import data_frame
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting import goodness
from sandbot_model.fitting.finite import check_finite
from sandbot_model.fitting.fitted import Fitted, state_at
from sandbot_model.fitting.global_minimum import Point, WarmStart, solve, solve_near
from sandbot_model.fitting.goodness import Estimate
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.plain import number, plain
from sandbot_model.fitting.text import (
    UNDETERMINED,
    WIDTH,
    cm_s,
    counted,
    html_table,
    probability,
    to_error,
    with_error,
    with_unit,
)
from sandbot_model.fitting.thresholds import GROSS, LACK_OF_FIT
from sandbot_model.fitting.uncertainty import standard_errors
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Fitted):
    """A fitted model, as plain data, tables and text."""

    @property
    def name(self) -> str:
        """The model in words: ``simple model + leg_slip``."""
        return " + ".join((f"{self.model.base} model", *self.effects))

    @property
    def undetermined(self) -> str:
        """Why the data determine no parameter, in words; empty if there are more cell means than unknowns."""
        if self.goodness.dof > 0:
            return ""
        return f"{counted(self.problem.values, 'cell mean')} can't determine {self.problem.fitted} parameters"

    @property
    def known_only_together(self) -> tuple[str, ...]:
        """Names, as in ``estimates``, of what the data determine only in combination, so that none has an error."""
        names = (*self.parameters, *(f"k at φ {phi:.3f}" for phi in self.level_phi))
        return tuple(name for name, error in zip(names, self.stderr, strict=True) if np.isinf(error))

    @property
    def errors_hold(self) -> bool:
        """Whether standard errors have a meaning: a test able to reveal a gross lack of fit has been passed, and no
        effect is ``stopped``, as its strength, held where the search ended, moves all other values."""
        tested = goodness.undetected_miss(int(self.cells.pure_error_dof.max())) <= GROSS
        return tested and self.lack_of_fit_p >= LACK_OF_FIT and not self.stopped

    @property
    def out_of_sample(self) -> str:
        """The error of mean speed out of sample: ``0.82 cm/s out of sample (12 of 35 cells scored)``."""
        return f"{cm_s(self.cv_rmse_m_s)} out of sample{scored(self)}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data: one step of the JSON of ``compare`` and ``discover``."""
        goodness, cv = self.goodness, self.cross_validation
        return {
            "effects": list(self.effects),
            "variants": self.variants,
            "rmse_m_s": number(self.rmse_m_s),
            "cv_rmse_m_s": number(self.cv_rmse_m_s),
            "rmse": {name: number(value) for name, value in self.rmse.items()},
            "cv_rmse": {name: number(value) for name, value in cv.rmse.items()},
            "cv_cells": cv.cells,
            "cv_deviance": number(cv.deviance),
            "chi2": number(goodness.chi2),
            "dof": goodness.dof,
            "lack_of_fit_p": number(goodness.lack_of_fit_p),
            "lack_of_fit": {name: number(value) for name, value in goodness.lack_of_fit.items()},
            "parameters": {
                name: {"value": number(value), "stderr": number(stderr)}
                for name, (value, stderr) in self.parameters.items()
            },
            "k_n_per_m": [
                {"phi": number(phi), "value": number(k), "stderr": number(stderr)}
                for phi, k, stderr in zip(self.level_phi, self.k_n_per_m, self.k_stderr_n_per_m, strict=True)
            ],
            "errors_hold": self.errors_hold,
            "known_only_together": list(self.known_only_together),
            "at_bounds": list(self.at_bounds),
            "implausible": list(self.implausible),
            # φ and ω identify the cell.
            "fails": [{key: value for key, value in plain(fail).items() if key != "cell"} for fail in self.fails],
        }

    def nuisances_to_dict(self) -> list[dict[str, Any]]:
        """The nuisances as plain data; empty where there are none.

        Batches are one entry: their number and the rms of their offsets.
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
        return data_frame(rows, "to_dict()").set_index("parameter")

    def residuals_frame(self) -> "DataFrame":
        """Measured and predicted [SI]: one row for each observable measured in a cell.

        Raises InputError where pandas is not installed.
        """
        cells = self.cells
        rows = [
            {
                "level_phi": self.level_phi[cells.level[cell]],
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
        return data_frame(rows, "to_dict()")

    def __repr__(self) -> str:
        cells, estimates = self.cells, self.estimates()
        width = max(28, *(len(name) + 2 for name, _ in estimates))
        lines = [
            textwrap.fill(f"{self.name}: fitted to {cells.trials} trials in {len(cells)} conditions", WIDTH),
            *(f"  {name:<{width}}{estimate}" for name, estimate in estimates),
            f"  {'error of mean speed':<{width}}{cm_s(self.rmse_m_s)} in sample, {self.out_of_sample}",
            f"  {'lack of fit p':<{width}}{probability(self.lack_of_fit_p)}",
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        errors = [("error of mean speed", f"{cm_s(self.rmse_m_s)} in sample, {self.out_of_sample}")]
        tests = [("lack of fit p", probability(self.lack_of_fit_p))]
        return html_table([(self.name, "value"), *self.estimates(), *errors, *tests])

    def estimates(self) -> list[tuple[str, str]]:
        """Each parameter and k(φ) with its value as text, rounded to its error."""
        units = ["" if parameter.unit == "1" else parameter.unit for parameter in self.model.parameters]
        levels = zip(self.level_phi, self.k_n_per_m, self.k_stderr_n_per_m, strict=True)
        estimates = [
            *((name, self.parameter_text(name), unit) for name, unit in zip(self.parameters, units, strict=True)),
            *((f"k at φ {phi:.3f}", self.value_text(k, stderr), "N/m") for phi, k, stderr in levels),
        ]
        return [(name, with_unit(text, unit)) for name, text, unit in estimates]

    def parameter_text(self, name: str) -> str:
        """A shared parameter ± standard error, or the value at which it is held."""
        value, stderr = self.parameters[name]
        return f"{value:.4g}, held" if name in self.model.held else self.value_text(value, stderr)

    def value_text(self, value: float, stderr: float) -> str:
        """A fitted value ± standard error, or to three digits unless ``errors_hold``; "not determined" where it is not
        or there are no more cell means than unknowns."""
        text = UNDETERMINED if self.undetermined else with_error(value, stderr)
        return text if self.errors_hold or text == UNDETERMINED else to_error(value, math.nan)


def scored(*fits: Fit) -> str:
    """How many cells the errors out of sample of these fits are of, such as `` (30 and 31 of 35 cells scored)``; empty
    where they are of all.
    """
    cells, counts = len(fits[0].cells), dict.fromkeys(fit.cross_validation.cells for fit in fits)
    few = any(count < cells for count in counts)
    return f" ({' and '.join(map(str, counts))} of {counted(cells, 'cell')} scored)" if few else ""


def fit(model: Model, cells: Cells, near: WarmStart | None = None) -> Fit:
    """The global minimum of the deviance over θ and one k per level.

    ``near`` is a warm start from the fit of a smaller model: the search begins at its k(φ) and tries its parameters as
    a start. Raises InputError where a user's effect gives no finite number.
    """
    check_finite(model, cells)
    return fitted_at(model, cells, solve((model, cells, near)))


def refitted(fit: Fit, nuisances: Nuisances) -> Fit:
    """The same model fitted with nuisances, from where it is."""
    point = solve_near((fit.model, fit.cells, (fit.warm_start,), nuisances))
    return fitted_at(fit.model, fit.cells, point, nuisances)


def fitted_at(model: Model, cells: Cells, point: Point, nuisances: Nuisances | None = None) -> Fit:
    """The fit at a known minimum, with its standard errors and tests; held parameters have no error."""
    problem = Problem(model, cells, nuisances)
    state = state_at(problem, point)
    jacobian = full_jacobian(problem, state)[0]
    free = np.ones(jacobian.shape[1])
    free[: len(point.theta)] = [name not in model.held for name in model.names]
    stderr, covariance = standard_errors(jacobian * free)
    own = len(point.theta) + len(point.ln_k)
    values = () if nuisances is None else problem.shared(state)[0].tolist()
    return Fit(
        model=model,
        cells=cells,
        point=point,
        stderr=stderr[:own],
        covariance=covariance[:own, :own],
        goodness=goodness.goodness(problem, state, jacobian),
        nuisances=nuisances and replace(nuisances, initial=np.array(values)),
        shared=tuple(Estimate(value, error) for value, error in zip(values, stderr[own:].tolist(), strict=True)),
    )
