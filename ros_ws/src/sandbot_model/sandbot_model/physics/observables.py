"""The four observables of a trial: names, columns, units."""

from enum import IntEnum
from typing import Self

import numpy as np

from sandbot_common.accuracy import Accuracy
from sandbot_common.arrays import Floats

CM = 100.0
"""Centimetres in a metre: observables are shown in cm or cm/s."""


class Observable(IntEnum):
    """What is measured of a trial.

    A member is its own index on the last axis of every ``(..., 4)`` array, ``cells.mean[:, Observable.lift]``, and its
    name is the one in JSON, ``Observable["lift"]``.
    """

    column: str
    """Column of the trials table [SI]."""
    label: str
    """Name shown to people."""
    unit: str
    """SI unit."""

    def __new__(cls, index: int, column: str, label: str, unit: str) -> Self:
        """The member of this index."""
        self = int.__new__(cls, index)
        self._value_ = index
        self.column, self.label, self.unit = column, label, unit
        return self

    speed = 0, "speed_m_s", "mean speed", "m/s"
    lift = 1, "lift_m", "body lift", "m"
    peak_speed = 2, "peak_speed_m_s", "peak speed", "m/s"
    first_step = 3, "first_step_m", "first step", "m"

    @property
    def readers_unit(self) -> str:
        """The unit shown to people, ``CM`` times finer than SI."""
        return f"c{self.unit}"

    @property
    def heading(self) -> str:
        """Label and reader's unit, for a column or an axis."""
        return f"{self.label} ({self.readers_unit})"


COLUMNS = tuple(observable.column for observable in Observable)
"""Columns of the trials table, in order."""
NAMES = tuple(observable.name for observable in Observable)
"""Names in JSON, in order."""


def usual_noise(accuracy: Accuracy) -> Floats:
    """Usual standard deviation of a single trial, for each observable ``(4,)`` [SI]."""
    names = (f"{observable.name}_sd_{observable.unit.replace('/', '_')}" for observable in Observable)
    return np.array([getattr(accuracy, name) for name in names])


def shared_variance(accuracy: Accuracy, values: Floats) -> Floats:
    """Variance of the error that all replicates share, for ``values (..., 4)`` [SI]."""
    constant = np.array([getattr(accuracy, observable.column) for observable in Observable])
    share = np.array([getattr(accuracy, f"{observable.name}_share") for observable in Observable])
    return np.asarray(constant**2 + (share * values) ** 2)
