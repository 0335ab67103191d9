"""At which stage of the chain a model fails: force balance d(ω, φ), geometry s(d), timing v(s), memory of the ground.

Each test compares two measured things, or one with the model, that only this stage connects:

    balance   lift against the model              Δz = 2R - h - d
    speed     mean speed against the lift's step  v̄ = ω s(Δz)/π, nothing fitted
    memory    first step against the lift's step  s_1 = s(Δz): virgin ground or a standing start differ if not
    clock     peak of v_x(t) against the model
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from sandbot_model.data.conditions import WALKING_LIFT_M, Cells
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.arrays import Array

SPEED, LIFT, PEAK, FIRST = range(4)
MISSED = 3.0


@dataclass(frozen=True)
class StageTest:
    """χ² of one stage's connection over the cells that tell it, and the (φ, ω) missed by more than 3 σ."""

    stage: str
    connects: str
    cells: int
    chi2: float
    p: float
    missed: tuple[tuple[float, float], ...]


def stage_tests(fit: Fit) -> tuple[StageTest, ...]:
    """All four, those without data left out."""
    cells = fit.cells
    walks = np.nan_to_num(cells.mean[:, LIFT]) > 4 * WALKING_LIFT_M
    tests = (
        _test("balance", "lift and model", cells, np.where(walks, fit.residual_z[:, LIFT], np.nan)),
        _test("speed", "mean speed and step from lift", cells, locked_z(fit, SPEED)),
        _test("memory", "first step and step from lift", cells, locked_z(fit, FIRST)),
        _test("clock", "peak speed and model", cells, np.where(walks, fit.residual_z[:, PEAK], np.nan)),
    )
    return tuple(one for one in tests if one.cells)


def locked_z(fit: Fit, observable: int) -> Array:
    """Measured minus locked, in standard errors ``(cells,)``: ωs(Δz)/π for the speed, s(Δz) for the first step."""
    cells, radius = fit.cells, fit.fitted.robot.leg_radius_m
    lift = np.where(np.nan_to_num(cells.mean[:, LIFT]) > 4 * WALKING_LIFT_M, cells.mean[:, LIFT], np.nan)
    scale = cells.omega / np.pi if observable == SPEED else np.ones_like(cells.omega)
    step = 2 * np.sqrt(lift * (2 * radius - lift))
    slope = scale * 4 * (radius - lift) / step
    gap = cells.mean[:, observable] - scale * step
    covariance = cells.covariance
    variance = (
        covariance[:, observable, observable]
        + slope**2 * covariance[:, LIFT, LIFT]
        - 2 * slope * covariance[:, observable, LIFT]
    )
    return np.asarray(gap / np.sqrt(variance))


def _test(stage: str, connects: str, cells: Cells, z: Array) -> StageTest:
    known = np.isfinite(z)
    total = float(np.sum(z[known] ** 2))
    missed = known & (np.abs(np.nan_to_num(z)) > MISSED)
    where = tuple((float(phi), float(omega)) for phi, omega in zip(cells.phi[missed], cells.omega[missed], strict=True))
    count = int(known.sum())
    return StageTest(stage, connects, count, total, float(chi2.sf(total, count)) if count else float("nan"), where)
