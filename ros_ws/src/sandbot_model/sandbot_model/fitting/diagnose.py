"""At which stage of the chain a model fails: force balance d(ω, φ), geometry s(d), timing v(s), memory of the ground.

Each test compares two measured quantities, or one with the model, that are linked by that stage alone:

    balance   lift against the model              Δz = 2R - h - d
    speed     mean speed against the lift's step  v̄ = ω s(Δz)/π, nothing fitted
    memory    first step against the lift's step  s_1 = s(Δz), unless virgin ground or a standing start matter
    clock     peak of v_x(t) against the model
"""

from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.data.distributions import f_sf
from sandbot_model.data.pure_error import effective_dof
from sandbot_model.data.regime import WALKING_LIFT_M, walks
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import FAIL_Z
from sandbot_model.physics.geometry import step_from_lift
from sandbot_model.physics.observables import Observable

LOCK_LIFT_M = 4 * WALKING_LIFT_M
"""Least lift from which a step is computed: ds/dΔz diverges towards zero lift, where the step is mostly noise."""


@dataclass(frozen=True)
class StageTest:
    """χ² of one stage's relation over the cells where both sides are known, and the (φ, ω) missed by more than 3 σ."""

    stage: str
    connects: str
    cells: int
    chi2: float
    p: float
    missed: tuple[tuple[float, float], ...]


def stage_tests(fit: Fit) -> tuple[StageTest, ...]:
    """The four tests, without those that have no data."""
    cells = fit.cells
    z = np.where(_clearly_lifted(cells)[:, None], fit.residual_z, np.nan)
    lift, speed, first_step, peak = Observable.lift, Observable.speed, Observable.first_step, Observable.peak_speed
    tests = (
        _test("balance", "lift and model", cells, z[:, lift], lift),
        _test("speed", "mean speed and step from lift", cells, locked_z(fit, speed), speed, lift),
        _test("memory", "first step and step from lift", cells, locked_z(fit, first_step), first_step, lift),
        _test("clock", "peak speed and model", cells, z[:, peak], peak),
    )
    return tuple(test for test in tests if test.cells)


def locked_z(fit: Fit, observable: Observable) -> Floats:
    """Measured minus geometry lock (ωs(Δz)/π for speed, s(Δz) for first step) in standard errors ``(cells,)``."""
    cells, radius = fit.cells, fit.model.robot.leg_radius_m
    lift = np.where(_clearly_lifted(cells), cells.mean[:, Observable.lift], np.nan)
    scale = cells.omega / np.pi if observable is Observable.speed else np.ones_like(cells.omega)
    step = step_from_lift(lift, radius)
    slope = scale * 4 * (radius - lift) / step
    gap = cells.mean[:, observable] - scale * step
    covariance = cells.covariance
    variance = (
        covariance[:, observable, observable]
        + slope**2 * covariance[:, Observable.lift, Observable.lift]
        - 2 * slope * covariance[:, observable, Observable.lift]
    )
    return np.asarray(gap / np.sqrt(variance))


def _clearly_lifted(cells: Cells) -> Bools:
    """Cells ``(n,)`` that walk with enough lift to compute a step from."""
    return np.isfinite(cells.mean[:, Observable.lift]) & walks(cells.mean, LOCK_LIFT_M)


def _test(stage: str, connects: str, cells: Cells, z: Floats, *measures: Observable) -> StageTest:
    """One test; its error degrees of freedom are the fewest of the observables ``measures`` that z is made of."""
    measured = np.isfinite(z)
    total = float(np.sum(z[measured] ** 2))
    missed = measured & (np.abs(np.nan_to_num(z)) > FAIL_Z)
    where = tuple((float(phi), float(omega)) for phi, omega in zip(cells.phi[missed], cells.omega[missed], strict=True))
    count, freedom = int(measured.sum()), effective_dof(cells.pure_error_dof)[[*measures]].min()
    return StageTest(
        stage, connects, count, total, float(f_sf(total / count, count, freedom)) if count else float("nan"), where
    )
