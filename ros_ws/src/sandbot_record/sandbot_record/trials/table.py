"""The trials table: one row per trial, SI units in the column names; NaN: not measured."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common.accuracy import Accuracy
from sandbot_common.arrays import Floats
from sandbot_common.data_frame import data_frame
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_record.trials.columns import (
    LEG_FREQUENCY,
    LENGTH,
    LIFT,
    NUMBER_OF_TRIALS,
    SD_OF_SPEED,
    SPEED,
    STANDARD_DEVIATION,
    VOLUME_FRACTION,
    Column,
    number,
    text,
)

if TYPE_CHECKING:
    from pandas import DataFrame

OK = "ok"
CONDITION = ("phi", "omega_rad_s")
"""Needed in every row that is ok."""
REQUIRED = (*CONDITION, "speed_m_s")
"""Needed of a trial that is used."""
MEASURED = ("speed_m_s", "lift_m", "peak_speed_m_s", "first_step_m")
"""The four observables."""


@dataclass(frozen=True)
class Row:
    """One trial. A field is a column of the table: what it holds, and what else it may be called in a CSV."""

    trial_id: str = text()
    phi: float = number(VOLUME_FRACTION, "phi", "φ", "volume_fraction", "packing_fraction", "solid_fraction")
    phi_sd: float = number(STANDARD_DEVIATION)
    omega_rad_s: float = number(
        LEG_FREQUENCY, "omega", "ω", "frequency", "freq", "f", "leg_frequency", "limb_frequency"
    )
    gait: str = text()
    replicate: float = number()
    speed_m_s: float = number(SPEED, "speed", "mean_speed", "average_speed", "forward_speed", "velocity", "v")
    speed_sd_m_s: float = number(SD_OF_SPEED, "speed_sd", "v_sd")
    lift_m: float = number(LIFT, "lift", "body_lift", "δz", "∆z")
    peak_speed_m_s: float = number(SPEED, "peak_speed")
    first_step_m: float = number(LENGTH, "first_step")
    batch: str = text(optional=True)
    """The group of trials with common conditions: a day, a preparation of the bed, a block of the plan."""
    run_order: float = number(optional=True)
    started: str = text(optional=True)
    """ISO 8601."""
    speed_sem_m_s: float = number(
        SD_OF_SPEED, "speed_sem", "speed_se", "speed_stderr", "speed_standard_error", "v_sem", "v_se", optional=True
    )
    """Standard error of a mean of trials."""
    n_trials: float = number(NUMBER_OF_TRIALS, "n", "replicates", "number_of_trials", optional=True)
    """The number of trials of which the row is the mean."""
    status: str = text(OK)


COLUMNS: dict[str, Column] = {own.name: own.metadata["column"] for own in fields(Row)}
"""The columns by name, in order."""


@dataclass(frozen=True, repr=False)
class Trials:
    """The table as arrays of shape (n,): text columns hold str, all others float64 (NaN: not measured).

    Every row is kept; ``usable`` is True where status is ok and the three required values are finite.
    """

    trial_id: NDArray[Any]
    phi: Floats
    phi_sd: Floats
    omega_rad_s: Floats
    gait: NDArray[Any]
    replicate: Floats
    speed_m_s: Floats
    speed_sd_m_s: Floats
    lift_m: Floats
    peak_speed_m_s: Floats
    first_step_m: Floats
    batch: NDArray[Any]
    run_order: Floats
    started: NDArray[Any]
    speed_sem_m_s: Floats
    n_trials: Floats
    status: NDArray[Any]
    robot: Robot | None = None
    """The robot of all trials; None: unknown."""
    frame_rate_hz: float = math.nan
    """Frame rate of the cameras; NaN: unknown."""
    accuracy: Accuracy | None = None
    """Accuracy of the cameras; None: unknown."""
    unread: tuple[str, ...] = ()
    """Notes on what was not taken from the files, such as unknown columns and trials given twice."""

    def __len__(self) -> int:
        return len(self.trial_id)

    def __repr__(self) -> str:
        usable = self.select(self.usable)
        line = f"Trials: {len(self)}, {len(usable)} of them usable"
        if not len(usable):
            return line
        spans = (("φ", usable.phi, ""), ("ω", usable.omega_rad_s, " rad/s"), ("speed", usable.speed_m_s, " m/s"))
        return f"{line}; " + ", ".join(f"{name} {low.min():.4g} to {low.max():.4g}{unit}" for name, low, unit in spans)

    def to_frame(self) -> "DataFrame":
        """The table as a pandas DataFrame, one row per trial. Raises InputError if pandas is not installed."""
        return data_frame({name: getattr(self, name) for name in COLUMNS}, "rows()")

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Mask of the rows that analysis may use."""
        finite = np.isfinite([getattr(self, name) for name in REQUIRED]).all(axis=0)
        good: NDArray[np.bool_] = finite & (self.status == OK)
        return good

    @property
    def excluded(self) -> int:
        """Number of rows that analysis may not use."""
        return int((~self.usable).sum())

    def rows(self) -> list[Row]:
        """The table row by row."""
        columns = [getattr(self, name).tolist() for name in COLUMNS]
        return [Row(*values) for values in zip(*columns, strict=True)]

    def select(self, which: NDArray[Any]) -> "Trials":
        """The rows selected by a mask or index array."""
        return replace(self, **{name: getattr(self, name)[which] for name in COLUMNS})


def from_rows(
    rows: Sequence[Row], robot: Robot | None = None, frame_rate_hz: float = math.nan, accuracy: Accuracy | None = None
) -> Trials:
    """A table of rows, with what they share."""
    columns: dict[str, Any] = {
        name: np.array([getattr(row, name) for row in rows], dtype=np.str_ if column.is_text else np.float64)
        for name, column in COLUMNS.items()
    }
    return Trials(**columns, robot=robot, frame_rate_hz=frame_rate_hz, accuracy=accuracy)


def check_usable(trials: Trials, where: str) -> None:
    """Raise InputError, beginning with ``where``, if no trial of the table is usable."""
    if trials.usable.any():
        return
    pairs = zip(trials.trial_id, trials.status.tolist(), strict=True)
    others = (f"{name} has status {status!r}, and only {OK} is used" for name, status in pairs if status != OK)
    why = next(others, "none has φ, ω and a speed")
    raise InputError(f"{where}: no usable trial among {len(trials)}: {why if len(trials) else 'the table is empty'}")


def check_ids(rows: Sequence[Row], where: Sequence[str]) -> None:
    """Raise InputError if two rows have the same id; ``where`` gives the location of each row."""
    seen: set[str] = set()
    for row, place in zip(rows, where, strict=True):
        if row.trial_id in seen:
            raise InputError(f"{place}: trial id {row.trial_id!r} is there twice; each trial needs its own")
        seen.add(row.trial_id)
