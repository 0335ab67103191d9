"""Trials gathered into cells: the replicates of one (volume fraction, leg frequency, gait), their means and scatter.

Everything after this works on cells, so its cost does not grow with the number of trials.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common.accuracy import USUAL, Accuracy
from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.clustering import OMEGA_TOLERANCE, conditions
from sandbot_model.data.covariate import local_slope, reliability
from sandbot_model.data.penetrometer import Pressed, Readings, at_levels
from sandbot_model.data.pure_error import consistent_cells, pure_error, within_batches, without_batch_effects
from sandbot_model.data.regime import (
    lifts_cut_off,
    peaks_of_some,
    peaks_seen,
    starts_on_both_tripods,
    swam_from_start,
    walks,
)
from sandbot_model.data.rounding import rounding_sd, shared_rounding_variance
from sandbot_model.data.stated_error import COLUMNS as STATED_COLUMNS
from sandbot_model.data.stated_error import of_single_trials, stated_bars, with_stated
from sandbot_model.data.two_groups import AGREEING, TwoGroups, far_apart, two_groups
from sandbot_model.physics.gait import USUAL_FRAME_RATE_HZ, Clock, clock
from sandbot_model.physics.observables import NAMES, Observable, shared_variance, usual_noise
from sandbot_record.trials.table import Trials


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells sorted by φ level, then ω. All arrays over cells have length n; the last axis is ``Observable``."""

    phi: Floats
    """Mean measured volume fraction, (n,)."""
    omega: Floats  # [rad/s], (n,)
    gait: tuple[str, ...]  # (n,)
    clock: Clock
    """How legs turn in the gait, (n,)."""
    level: Ints
    """Index into level_phi, (n,)."""
    level_phi: Floats
    """Mean volume fraction of a level, (levels,)."""
    n: Ints
    """Replicates in which the observable was measured, (n, 4)."""
    mean: Floats
    """Cell means corrected to the level's φ, (n, 4); NaN where not measured."""
    sd: Floats
    """Replicate scatter of the cell, (n, 4); NaN below two."""
    sem: Floats
    """Standard error of the mean, from pooled pure error, (n, 4)."""
    noise: Floats
    """Pure error: pooled standard deviation of one trial, (4,); NaN if unknown."""
    covariance: Floats
    """Covariance of the cell means, (n, 4, 4)."""
    pure_error_dof: Ints
    """Degrees of freedom of the pure error, (4,)."""
    own_scatter: NDArray[np.bool_]
    """Cells whose own scatter is used, not the pooled one, (n,) (see ``pure_error``)."""
    phi_scatter: float
    """Standard deviation of measured φ among replicates: how well the bed meets its target."""
    trials: int
    excluded: int = 0
    pressed: Pressed | None = None
    """Penetrometer readings at the levels (see ``penetrometer``)."""
    robot: Robot = SANDBOT
    """The robot that walked."""
    accuracy: Accuracy = USUAL
    """How well it was measured."""
    bars_of_trials: bool = False
    """Whether there are error bars of single trials, which do not give pure error (see ``stated_error``)."""
    error_bars: bool = False
    """Whether pure error is that of the error bars given, and not the scatter of replicates."""
    batch_share: Floats | None = None
    """Fraction of a cell's trials in each batch, (n, batches); None: at most one is named."""
    batch_mean: Floats | None = None
    """Mean of a cell's trials in each batch, (n, batches, 4); NaN without any."""
    order: Floats | None = None
    """Mean position in the run order from -1/2 to 1/2, (n,); None: unknown."""
    batch_order: Floats | None = None
    """The same of a cell's trials in each batch, (n, batches); NaN without any."""
    two_groups: TwoGroups | None = None
    """The split of the trials that removes most of the scatter of replicates, if that scatter is suspicious."""

    @property
    def observables(self) -> tuple[str, ...]:
        """The observables measured in at least one cell."""
        return tuple(observable.name for observable in Observable if np.isfinite(self.mean[:, observable]).any())

    @property
    def pure_error_from(self) -> str:
        """What gives the pure error, in words: ``replicates`` or ``error bars``."""
        return "error bars" if self.error_bars else "replicates"

    @property
    def scatter(self) -> str:
        """What a misfit is compared with, in words."""
        return "the error bars" if self.error_bars else "the scatter of replicates"

    @property
    def notes(self) -> tuple[str, ...]:
        """Which penetrometer readings are not used, one sentence each."""
        return self.pressed.notes if self.pressed else ()

    def __len__(self) -> int:
        return len(self.omega)

    def without(self, cells: int | NDArray[np.int64]) -> "Cells":
        """All cells but these, without batches that then have no trial; all levels are kept, even if empty."""
        keep = ~np.isin(np.arange(len(self)), cells)
        over_cells = {name: value for name, value in vars(self).items() if name not in NOT_OVER_CELLS}
        shorter: dict[str, Any] = {
            name: value[keep] for name, value in over_cells.items() if isinstance(value, np.ndarray)
        }
        if self.batch_share is not None:
            kept = shorter["batch_share"].any(axis=0)
            shorter |= {name: shorter[name][:, kept] for name in OVER_BATCHES if name in shorter}
        removed, gait = int(self.n[~keep].max(axis=1).sum()), tuple(np.array(self.gait)[keep].tolist())
        shorter |= {"trials": self.trials - removed, "excluded": self.excluded + removed}
        return replace(self, gait=gait, clock=self.clock[keep], **shorter)


NOT_OVER_CELLS = ("level_phi", "noise", "pure_error_dof")
"""Arrays of ``Cells`` that are not over cells."""
OVER_BATCHES = ("batch_share", "batch_mean", "batch_order")
"""Those that are over cells and batches."""


def cells_of(trials: Trials, readings: Readings | None = None) -> Cells:
    """Gather trials into cells. Trials that are not ``usable``, or without ω, are left out and counted.

    Trials without a robot are taken to be SandBot's, those without a frame rate to be filmed at the usual one.
    ``readings`` are a penetrometer's. Raises InputError if no trial is left, or no reading is at the trials' φ.
    """
    usable = trials.usable & (trials.omega_rad_s > 0)
    if not usable.any():
        raise InputError(
            f"none of {len(trials)} trials can be used: phi, omega_rad_s and speed_m_s of an ok trial are needed"
        )
    some = trials.select(usable)
    values = np.stack([getattr(some, observable.column) for observable in Observable], axis=-1)
    rate_hz = trials.frame_rate_hz if np.isfinite(trials.frame_rate_hz) else USUAL_FRAME_RATE_HZ
    robot, accuracy = trials.robot or SANDBOT, trials.accuracy or USUAL
    gait, omega = some.gait, some.omega_rad_s
    values[~peaks_seen(gait, omega, values, robot, accuracy, rate_hz), Observable.peak_speed] = np.nan
    values[swam_from_start(gait, omega, values) | starts_on_both_tripods(gait), Observable.first_step] = np.nan
    stated = np.stack([getattr(some, name) for name in STATED_COLUMNS])
    cells = _gather(some, values, stated, accuracy, excluded=len(trials) - len(some))
    cells = replace(cells, robot=robot, accuracy=accuracy, bars_of_trials=of_single_trials(stated))
    return cells if readings is None else replace(cells, pressed=at_levels(readings, cells.level_phi, robot))


def level_name(cells: Cells, cell: int) -> str:
    """The φ of a cell's level, by which text, tables and figures name the cell."""
    return f"{cells.level_phi[cells.level[cell]]:.3f}"


def cell_of(trials: Trials, cells: Cells) -> Ints:
    """Index of the cell that each trial, even an excluded one, belongs to ``(trials,)``; -1 if to none."""
    level = np.abs(trials.phi[:, None] - cells.level_phi).argmin(axis=1)
    same = (level[:, None] == cells.level) & np.isfinite(trials.phi)[:, None]
    same &= np.abs(trials.omega_rad_s[:, None] - cells.omega) <= OMEGA_TOLERANCE * cells.omega
    same &= np.array([str(gait) for gait in trials.gait])[:, None] == np.array(cells.gait)
    return np.where(same.any(axis=1), same.argmax(axis=1), -1)


@dataclass(frozen=True, eq=False)
class _Groups:
    """Which group each trial belongs to, ``index (trials,)``, and how many groups there are."""

    index: Ints
    count: int

    def mean(self, column: Floats) -> Floats:
        """Mean of each group ``(groups,)`` over what was measured; NaN where nothing was."""
        measured = np.isfinite(column)
        total = np.bincount(self.index, np.where(measured, column, 0.0), self.count)
        with np.errstate(invalid="ignore"):
            return np.asarray(total / np.bincount(self.index, measured, self.count))

    def means(self, values: Floats) -> Floats:
        """The same of every column of ``values (trials, 4)``."""
        return np.stack([self.mean(column) for column in values.T], axis=-1)

    def measured(self, values: Floats) -> Ints:
        """How many values of a group were measured ``(groups, 4)``."""
        counts = [np.bincount(self.index, np.isfinite(column), self.count) for column in values.T]
        return np.stack(counts, axis=-1).astype(np.int64)

    def sd(self, residual: Floats) -> Floats:
        """Scatter of each group ``(groups, 4)`` from residuals about its mean; NaN below two values."""
        squares = [np.bincount(self.index, np.nan_to_num(column) ** 2, self.count) for column in residual.T]
        n = self.measured(residual)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(n > 1, np.sqrt(np.stack(squares, axis=-1) / (n - 1)), np.nan)


def _gather(trials: Trials, values: Floats, stated: Floats, accuracy: Accuracy, excluded: int) -> Cells:
    """Cells of usable trials, from those of their ``values (trials, 4)`` that count, with their ``stated`` errors."""
    phi, omega, batch = trials.phi, trials.omega_rad_s, trials.batch
    cell, keys = conditions(phi, trials.gait, omega)
    level = keys[0, cell]
    cells, levels = _Groups(cell, keys.shape[1]), _Groups(level, int(level.max()) + 1)
    level_phi, cell_phi, cell_omega = levels.mean(phi), cells.mean(phi), cells.mean(omega)
    walking = walks(cells.means(values))
    values[peaks_of_some(values, cell), Observable.peak_speed] = np.nan
    # Where some of a condition walked, the mean is of all its trials.
    walked = np.bincount(cell, walks(values), cells.count)
    all_swam = walked == 0
    values[lifts_cut_off(values) & all_swam[cell], Observable.lift] = np.nan
    rounding = rounding_sd(values)
    values = _at_level_phi(values, phi - level_phi[level], phi - cell_phi[cell], cells, keys, level_phi, walking)
    mean, count = cells.means(values), cells.measured(values)
    usual = usual_noise(accuracy)
    shape = np.where(np.arange(len(Observable)) == Observable.lift, 1.0, mean)
    residual = values - mean[cell]
    consistent = consistent_cells(residual, cell, count, walking, cell_omega, rounding)
    residual = without_batch_effects(residual, cell, shape, batch, consistent)
    one_regime = all_swam | (walked == np.bincount(cell))
    residual, independent = within_batches(residual, cell, count, batch, consistent & one_regime)
    of_replicates = pure_error(residual, cell, independent, walking, cell_omega, usual, rounding)
    slope = local_slope(mean, keys, level_phi, walking)[cell, Observable.speed]
    bars = cells.means(stated_bars(stated, slope).T).T
    error = with_stated(of_replicates, bars, walking, cell_omega, usual)
    alike = shared_rounding_variance(rounding, np.diagonal(error.covariance, axis1=1, axis2=2), count)
    covariance = _covariance_of_means(error.covariance, count, usual) + _shared_covariance(mean, accuracy, alike)
    questioned = far_apart(error.sd, usual).sum() >= AGREEING
    names = tuple(np.unique(trials.gait)[keys[1]].tolist())
    position = _run_position(trials.run_order)
    share, by_batch, batch_order = _by_batch(batch, values, position, cells)
    return Cells(
        phi=cell_phi,
        omega=cell_omega,
        gait=names,
        clock=clock(names),
        level=keys[0],
        level_phi=level_phi,
        phi_scatter=_pooled_sd(phi - cell_phi[cell], len(phi) - cells.count),
        n=count,
        mean=mean,
        sd=cells.sd(values - mean[cell]),
        sem=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        noise=error.sd,
        covariance=covariance,
        pure_error_dof=error.dof,
        own_scatter=error.own,
        trials=len(phi),
        excluded=excluded,
        error_bars=error is not of_replicates,
        batch_share=share,
        batch_mean=by_batch,
        order=None if position is None else cells.mean(position),
        batch_order=batch_order,
        two_groups=_two_groups(trials, residual, cell, ~error.own[cell]) if questioned else None,
    )


def _two_groups(trials: Trials, residual: Floats, cell: Ints, some: NDArray[np.bool_]) -> TwoGroups | None:
    """Two groups into which ``some`` trials fall by their ``residual (trials, 4)`` about their cell means."""
    return two_groups(residual[some], cell[some], trials.trial_id[some], trials.run_order[some])


def _by_batch(
    batch: NDArray[np.str_], values: Floats, position: Floats | None, cells: _Groups
) -> tuple[Floats | None, Floats | None, Floats | None]:
    """``batch_share``, ``batch_mean`` and ``batch_order``, in an order independent of names; None where at most one is
    named."""
    if len(np.unique(batch)) < 2:
        return None, None, None
    # Trials without a batch are grouped by condition, as they are where no trial names any.
    own_condition = np.char.add("\0", cells.index.astype(str))
    names, index = np.unique(np.where(batch == "", own_condition, batch), return_inverse=True)
    own = index[:, None] == np.arange(len(names))
    share = cells.means(own.astype(float))
    mean = np.stack([cells.means(np.where(of[:, None], values, np.nan)) for of in own.T], axis=1)
    # By the cells of each batch, then by their means: a sample of the posterior depends on the order of its unknowns.
    by_content = np.lexsort(np.concatenate([np.nan_to_num(mean).swapaxes(1, 2).reshape(-1, len(names)), share]))
    share, mean = share[:, by_content], mean[:, by_content]
    if position is None:
        return share, mean, None
    return share, mean, cells.means(np.where(own, position[:, None], np.nan))[:, by_content]


def _run_position(order: Floats) -> Floats | None:
    """Position of each trial in the run order, from -1/2 for the first to 1/2 for the last."""
    if not np.isfinite(order).all() or not np.ptp(order) > 0:
        return None
    return np.asarray((order - order.min()) / np.ptp(order) - 0.5)


def _at_level_phi(
    values: Floats, from_level: Floats, from_cell: Floats, cells: _Groups, keys: Ints, level_phi: Floats, walking: Bools
) -> Floats:
    """Values ``(trials, 4)`` corrected to their level's φ.

    ``from_level``, ``from_cell (trials,)`` are the deviations of φ from its level's mean and from its cell's.
    """
    mean = cells.means(values)
    slope = local_slope(mean, keys, level_phi, walking)[cells.index]
    rho = reliability(values - mean[cells.index], slope * from_cell[:, None])
    return values - rho * slope * from_level[:, None]


def _covariance_of_means(covariance: Floats, count: Ints, usual: Floats) -> Floats:
    """Covariance of cell means from that of one trial ``(n, 4, 4)`` and the number of replicates ``(n, 4)``.

    Without any replicates pure error is unknown: the ``usual`` one ``(4,)`` gives weights, but nothing can be tested.
    """
    unknown = ~np.isfinite(np.diagonal(covariance, axis1=1, axis2=2))
    scale = np.where(unknown[:, :, None] | unknown[:, None, :], np.diag(np.square(usual)), covariance)
    root = np.sqrt(np.where(count > 0, count, np.nan).astype(float))
    return np.asarray(scale / root[:, :, None] / root[:, None, :])


def _shared_covariance(mean: Floats, accuracy: Accuracy, rounding: Floats) -> Floats:
    """Covariance ``(n, 4, 4)`` of errors that all replicates of a cell share: those of the cameras at cell means
    ``mean (n, 4)``, and shared ``rounding (n, 4)`` errors.
    """
    variance = shared_variance(accuracy, np.nan_to_num(mean)) + rounding
    return np.asarray(variance[:, :, None] * np.eye(len(Observable)))


def _pooled_sd(residual: Floats, dof: int) -> float:
    return float(np.sqrt(np.sum(residual**2) / dof)) if dof > 0 else 0.0


def noise_floor(cells: Cells) -> dict[str, float]:
    """Pure error of one trial for each observable: rms scatter of replicates about their mean [SI].

    Cells where some replicates walk and others swim scatter between two values, not about one; they are left out.
    """
    return dict(zip(NAMES, cells.noise.tolist(), strict=True))
