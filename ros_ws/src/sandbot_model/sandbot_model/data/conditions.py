"""Trials gathered into cells: the replicates of one (volume fraction, leg frequency, gait) and what they scatter.

Everything after this works on cells, so its cost does not grow with the number of trials.
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.clustering import phi_levels, same_within
from sandbot_model.data.covariate import local_slope, reliability
from sandbot_model.data.penetrometer import Pressed, Readings, at_levels
from sandbot_model.data.pure_error import pure_error
from sandbot_model.data.regime import swum_at_once, walks
from sandbot_model.physics.gait import USUAL_FRAME_RATE_HZ, peak_is_resolved, slow_phase_ratio
from sandbot_model.physics.observables import NAMES, USUAL_NOISE, Observable
from sandbot_record.trials.table import Trials

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells sorted by φ level, then ω. All arrays over cells have length n; the last axis is ``Observable``."""

    phi: Floats = field(metadata={"shape": "(n,)", "doc": "mean measured volume fraction"})
    omega: Floats = field(metadata={"shape": "(n,)", "unit": "rad/s"})
    gait: tuple[str, ...] = field(metadata={"shape": "(n,)"})
    slow_phase_ratio: Floats = field(metadata={"shape": "(n,)", "doc": "β of the gait"})
    level: Ints = field(metadata={"shape": "(n,)", "doc": "index into level_phi"})
    level_phi: Floats = field(metadata={"shape": "(levels,)", "doc": "mean volume fraction of a level"})
    n: Ints = field(metadata={"shape": "(n, 4)", "doc": "replicates in which the observable was measured"})
    mean: Floats = field(
        metadata={"shape": "(n, 4)", "doc": "cell means brought to the level's φ; NaN where not measured"}
    )
    sd: Floats = field(metadata={"shape": "(n, 4)", "doc": "replicate scatter of the cell; NaN below two"})
    sem: Floats = field(metadata={"shape": "(n, 4)", "doc": "standard error of the mean, from pooled pure error"})
    noise: Floats = field(metadata={"shape": "(4,)", "doc": "pure error: pooled sd of one trial; NaN if unknown"})
    covariance: Floats = field(metadata={"shape": "(n, 4, 4)", "doc": "covariance of the cell means"})
    pure_error_dof: Ints = field(metadata={"shape": "(4,)", "doc": "degrees of freedom of the pure error"})
    own_scatter: NDArray[np.bool_] = field(
        metadata={"doc": "(n,), cells taken at their own scatter (see ``pure_error``)"}
    )
    phi_scatter: float = field(metadata={"doc": "sd of measured φ among replicates: how well the bed meets its target"})
    phi_reliability: float = field(
        metadata={"doc": "share ρ of the measured deviation of φ that is real (see ``covariate``)"}
    )
    trials: int
    excluded: int = 0
    pressed: Pressed | None = None
    """What a penetrometer says of the levels (see ``penetrometer``)."""
    robot: Robot = SANDBOT
    """The robot that walked."""

    @property
    def observables(self) -> tuple[str, ...]:
        """The observables that were measured at all."""
        return tuple(one.name for one in Observable if np.isfinite(self.mean[:, one]).any())

    def __len__(self) -> int:
        return len(self.omega)

    def without(self, cell: int) -> "Cells":
        """All cells but one; the levels stay, even if one of them is empty then."""
        keep = np.arange(len(self)) != cell
        each = {one.name: getattr(self, one.name) for one in fields(self)}
        shorter = {
            name: values[keep] for name, values in each.items() if isinstance(values, np.ndarray) and name not in WHOLE
        }
        return replace(self, gait=tuple(gait for gait, kept in zip(self.gait, keep, strict=True) if kept), **shorter)


WHOLE = ("level_phi", "noise", "pure_error_dof")
"""Arrays of ``Cells`` that are not over cells."""

OMEGA_TOLERANCE = 5e-3
"""Leg frequencies closer than this (relative) are the same condition."""


def cells_of(trials: Trials, readings: Readings | None = None) -> Cells:
    """Gather trials into cells. Trials without φ, ω or any observable, or not ended ``ok``, are left out and counted.

    Trials that don't tell their robot are SandBot's, filmed at the usual rate. ``readings`` are a penetrometer's.
    Raises InputError if no trial is left, or no reading is at the trials' φ.
    """
    phi, omega = np.asarray(trials.phi, dtype=float), np.asarray(trials.omega_rad_s, dtype=float)
    values = np.stack([np.asarray(getattr(trials, one.column), dtype=float) for one in Observable], axis=-1)
    status = np.asarray([str(one) for one in trials.status])
    usable = np.isfinite(phi) & np.isfinite(omega) & (omega > 0) & np.isfinite(values).any(axis=-1)
    usable &= np.isin(status, ["", "ok"])
    if not usable.any():
        raise InputError(
            f"none of {len(phi)} trials can be used: phi, omega_rad_s and speed_m_s of an ok trial are needed"
        )
    gait = np.asarray([str(one) for one in trials.gait])[usable]
    phi, omega, values = phi[usable], omega[usable], values[usable]
    rate_hz = trials.frame_rate_hz if np.isfinite(trials.frame_rate_hz) else USUAL_FRAME_RATE_HZ
    blurred = [not peak_is_resolved(name, frequency, rate_hz) for name, frequency in zip(gait, omega, strict=True)]
    values[blurred, Observable.peak_speed] = np.nan
    values[swum_at_once(gait, omega, values), Observable.first_step] = np.nan
    cells = _gather(phi, omega, gait, values, excluded=int((~usable).sum()))
    cells = replace(cells, robot=trials.robot or SANDBOT)
    return cells if readings is None else replace(cells, pressed=at_levels(readings, cells.level_phi))


def _gather(phi: Floats, omega: Floats, gait: NDArray[np.str_], values: Floats, excluded: int) -> Cells:
    level, frequency = phi_levels(phi), same_within(omega, OMEGA_TOLERANCE)
    gaits, gait_index = np.unique(gait, return_inverse=True)
    keys, cell = np.unique(np.stack([level, gait_index, frequency]), axis=1, return_inverse=True)
    cells = keys.shape[1]

    def average(column: Floats, index: Ints = cell, length: int = cells) -> Floats:
        known = np.isfinite(column)
        total = np.bincount(index, np.where(known, column, 0.0), length)
        with np.errstate(invalid="ignore"):
            return np.asarray(total / np.bincount(index, known, length))

    count = np.stack([np.bincount(cell, np.isfinite(column), cells) for column in values.T], axis=-1).astype(np.int64)
    level_phi = average(phi, level, int(level.max()) + 1)
    mean = np.stack([average(column) for column in values.T], axis=-1)
    walking = walks(mean)
    slope = local_slope(mean, keys, level_phi, walking)[cell]
    rho = reliability(values - mean[cell], slope * (phi - average(phi)[cell])[:, None])
    values = values - rho * slope * (phi - level_phi[level])[:, None]
    mean = np.stack([average(column) for column in values.T], axis=-1)
    error = pure_error(values - mean[cell], cell, count, walking, average(omega))
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(np.where(count > 0, count, np.nan).astype(float))
        spread = np.where(count > 1, np.sqrt(_squares(values - mean[cell], cell, cells) / (count - 1)), np.nan)
    variance = np.diagonal(error.covariance, axis1=1, axis2=2)
    # Without any replicates pure error is unknown: weights are then the usual ones, and nothing can be tested.
    unknown = ~np.isfinite(variance)
    scale = np.where(unknown[:, :, None] | unknown[:, None, :], np.diag(np.square(USUAL_NOISE)), error.covariance)
    covariance = scale / root[:, :, None] / root[:, None, :] + _accuracy(mean)
    names = tuple(str(gaits[index]) for index in keys[1])
    return Cells(
        phi=average(phi),
        omega=average(omega),
        gait=names,
        slow_phase_ratio=np.array([slow_phase_ratio(name) for name in names]),
        level=keys[0],
        level_phi=level_phi,
        phi_reliability=rho,
        phi_scatter=_scatter(phi - average(phi)[cell], cells),
        n=count,
        mean=mean,
        sd=spread,
        sem=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        noise=error.sd,
        covariance=covariance,
        pure_error_dof=error.dof,
        own_scatter=error.own,
        trials=len(phi),
        excluded=excluded,
    )


def _accuracy(mean: Floats) -> Floats:
    """Variances ``(n, 4, 4)`` that ``Observable.accuracy`` adds to the cell means ``mean (n, 4)``."""
    offset, share = np.array([one.accuracy for one in Observable]).T
    return np.asarray((offset**2 + (share * np.nan_to_num(mean)) ** 2)[:, :, None] * np.eye(len(Observable)))


def _squares(residual: Floats, cell: Ints, cells: int) -> Floats:
    return np.stack([np.bincount(cell, np.nan_to_num(column) ** 2, cells) for column in residual.T], axis=-1)


def _scatter(residual: Floats, cells: int) -> float:
    dof = len(residual) - cells
    return float(np.sqrt(np.sum(residual**2) / dof)) if dof > 0 else 0.0


def noise_floor(cells: Cells) -> dict[str, float]:
    """Pure error of one trial for each observable: rms scatter of replicates about their mean [SI].

    Cells where some replicates walk and others swim scatter between two values, not about one; they are not in.
    """
    return dict(zip(NAMES, cells.noise.tolist(), strict=True))
