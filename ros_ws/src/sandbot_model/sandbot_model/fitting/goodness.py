"""Goodness of fit: rms errors, cell means missed, and lack-of-fit tests against pure error."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.data.distributions import chi2_ppf, chi2_sf, f_isf, f_sf
from sandbot_model.data.pure_error import FEW_REPLICATES, effective_dof
from sandbot_model.fitting.levenberg_marquardt import bounds
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import effective
from sandbot_model.fitting.states import States
from sandbot_model.fitting.thresholds import LACK_OF_FIT
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES

FAIL_Z = 3.0
"""Cell means missed by more standard errors than this are listed as failing."""
AT_BOUND = 1e-3
PLAUSIBLE_SIGMAS, FAR_OUT = 3.0, 0.25


class Estimate(NamedTuple):
    """A fitted value with its standard error: NaN where the data do not determine it, ∞ where only with others."""

    value: float
    stderr: float


@dataclass(frozen=True)
class Goodness:
    """How well a fit describes the trials it was fitted to, relative to the scatter of replicates."""

    rmse: Mapping[str, float]
    """Of each observable [SI], rms over trials of measured minus model, so that a perfect model reaches the noise
    floor. Cells where the robot walks or swims by chance, in the replicates or by the model, have no single value to
    predict and are left out."""
    chi2: float
    deviance: float
    """-2 ln likelihood up to a constant: χ² plus the ln |V_c/V_c0| of cells near the switch to swimming."""
    dof: int
    bic: float
    """Bayesian information criterion (Schwarz 1978): deviance + unknowns · ln(values)."""
    lack_of_fit_p: float
    """F test of the cell means against pure error, all observables together; NaN without replicates."""
    lack_of_fit_f: float
    """The statistic of that test: mean square of the misfit over pure error."""
    lack_of_fit: Mapping[str, float]
    """The same for each observable, and for a penetrometer's readings."""


def goodness(problem: Problem, state: States, jacobian: Floats) -> Goodness:
    """Errors and tests of a fitted state (one row), with its ``full_jacobian (residuals, unknowns)``."""
    unknowns = state.theta.shape[1] + state.ln_k.shape[1]
    gap, chi2, deviance = residual(problem, state), float(np.sum(state.all_residuals**2)), float(state.deviance[0])
    clear = problem.away_from_switch(problem.widening(state.covariance[0]))
    dof, z = problem.values - problem.fitted, residual_z(problem, state)
    tested = chi2 - excess_of_few_replicates(z, problem.cells)
    return Goodness(
        rmse=rms(problem.cells, np.where(clear[:, None], gap, np.nan)),
        chi2=chi2,
        deviance=deviance,
        dof=dof,
        bic=deviance + unknowns * float(np.log(problem.values)),
        lack_of_fit_p=joint_p(tested, dof, problem.cells),
        lack_of_fit_f=tested / dof if dof > 0 else float("nan"),
        lack_of_fit=p_by_observable(z, problem, problem.fitted + _shared_unknowns(problem, jacobian))
        | p_of_readings(state),
    )


def residual(problem: Problem, state: States) -> Floats:
    """Measured minus model ``(cells, 4)`` [SI], NaN where not measured; ``state`` is one row."""
    return np.where(problem.measured, problem.cells.mean - state.predicted[0], np.nan)


def residual_z(problem: Problem, state: States) -> Floats:
    """``residual (cells, 4)`` in standard errors of the cell mean."""
    return np.asarray(residual(problem, state) / np.sqrt(np.diagonal(state.covariance[0], axis1=1, axis2=2)))


@dataclass(frozen=True)
class Fail:
    """One cell mean the model misses: residual = measured - model, z = residual over its standard error."""

    observable: str
    phi: float
    omega_rad_s: float
    residual: float
    z: float
    cell: int
    """Index of the cell among those fitted: two gaits may share φ and ω."""

    @property
    def stderr(self) -> float:
        """Standard error of the residual [SI]."""
        return abs(self.residual / self.z)


def rms(cells: Cells, gap: Floats) -> dict[str, float]:
    """Rms over trials [SI], from the ``gap (cells, 4)`` of cell mean and model and the scatter about the cell mean."""
    n = np.where(np.isfinite(gap), cells.n, 0)
    within = np.where(n > 1, (n - 1) * np.nan_to_num(cells.sd) ** 2, 0.0).sum(axis=0)
    between = (n * np.nan_to_num(gap) ** 2).sum(axis=0)
    total = n.sum(axis=0)
    return {
        name: float(np.sqrt((within[i] + between[i]) / total[i])) if total[i] else float("nan")
        for i, name in enumerate(NAMES)
    }


def fails(cells: Cells, gap: Floats, z: Floats) -> tuple[Fail, ...]:
    """Cell means missed by more than ``FAIL_Z`` standard errors, the worst first; ``gap`` [SI] and ``z (cells, 4)``."""
    rows = np.argwhere(np.nan_to_num(np.abs(z)) > FAIL_Z)
    rows = rows[np.argsort(-np.abs(z[rows[:, 0], rows[:, 1]]))]
    return tuple(
        Fail(NAMES[o], float(cells.phi[c]), float(cells.omega[c]), float(gap[c, o]), float(z[c, o]), int(c))
        for c, o in rows
    )


def cells_missed(failing: Iterable[Fail]) -> int:
    """How many cells are missed; one missed in several observables counts once."""
    return len({fail.cell for fail in failing})


def joint_p(chi2: float, dof: int, cells: Cells) -> float:
    """Lack-of-fit F test of all observables together against pure error, on the degrees of freedom of the observable
    known best (not their sum, see docs/statistics.md); NaN without replicates."""
    error_dof = int(cells.pure_error_dof.max())
    if dof < 1 or error_dof < 1:
        return float("nan")
    return float(f_sf(chi2 / dof, dof, error_dof))


def undetected_miss(known: int, p: float = LACK_OF_FIT) -> float:
    """Miss of every cell mean, in standard errors, that just passes with ``known`` degrees of freedom of pure error.

    The lack-of-fit F test with many cells: F(p; ∞, ν) = ν/χ²(p; ν). Infinite without pure error.
    """
    return float(np.sqrt(known / chi2_ppf(p, known))) if known else float("inf")


def excess_of_few_replicates(z: Floats, cells: Cells) -> float:
    """Part of χ² that may be due to a pure error known from few replicates, which can be far too small by chance.

    For each such observable: χ² minus the value that has the same p with the pure-error degrees of freedom of the
    observable known best.
    """
    freedom = effective_dof(cells.pure_error_dof)
    found = 0.0
    for observable in np.flatnonzero(cells.pure_error_dof < FEW_REPLICATES):
        own = z[np.isfinite(z[:, observable]), observable]
        if own.size and freedom[observable] < freedom.max():
            chi2 = float(own @ own)
            p = float(f_sf(chi2 / own.size, own.size, freedom[observable]))
            found += max(chi2 - own.size * f_isf(p, own.size, freedom.max()), 0.0)
    return found


def _shared_unknowns(problem: Problem, jacobian: Floats) -> float:
    """Effective number of fitted nuisances."""
    if problem.nuisances is None:
        return 0
    count = len(problem.nuisances.sd)
    return effective(jacobian[:-count, -count:] * problem.nuisances.sd)


def p_by_observable(z: Floats, problem: Problem, unknowns: float) -> dict[str, float]:
    """p of each observable on its own, with its fraction of the fitted unknowns taken off its degrees of freedom."""
    measured = problem.measured.sum(axis=0)
    share = unknowns / max(int(measured.sum()), 1)
    found = {}
    for index, name in enumerate(NAMES):
        dof = measured[index] * (1 - share)
        error_dof = problem.cells.pure_error_dof[index]
        if measured[index]:
            ratio = np.nansum(z[:, index] ** 2) / max(dof, 1e-9)
            found[name] = float(f_sf(ratio, dof, error_dof)) if dof > 0 and error_dof else float("nan")
    return found


def p_of_readings(state: States) -> dict[str, float]:
    """p of a penetrometer's readings, whose standard deviations are given (χ² test)."""
    count = state.pressed.shape[1]
    return {"penetration": float(chi2_sf(np.sum(state.pressed**2), count))} if count else {}


def at_bounds(problem: Problem, theta: Floats) -> tuple[str, ...]:
    """Names of shared parameters ``theta (n,)`` at an end of their search range, held ones excepted."""
    low, high = bounds(problem)
    edge = AT_BOUND * (high - low)
    pressed = ((theta <= low + edge) | (theta >= high - edge)) & (low < high)
    return tuple(name for name, at in zip(problem.model.names, pressed, strict=True) if at)


def implausible(model: Model, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Shared parameters outside their plausible range by more than ``PLAUSIBLE_SIGMAS`` standard errors or by
    ``FAR_OUT`` of its width: an error as wide as the range excuses no value.
    """
    found = []
    for name, parameter in zip(model.names, model.parameters, strict=True):
        value, error = estimates[name]
        margin = min(PLAUSIBLE_SIGMAS * (0.0 if np.isnan(error) else error), FAR_OUT * parameter.width)
        if value < parameter.low - margin or value > parameter.high + margin:
            found.append(name)
    return tuple(found)
