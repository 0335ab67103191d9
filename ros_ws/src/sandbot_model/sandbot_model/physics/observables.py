"""The four observables of a trial: names, columns, units, and how well they are usually measured."""

from enum import IntEnum
from typing import Self

import numpy as np

CM = 100.0
"""Centimetres in a metre: a person reads every observable in cm or cm/s."""


class Observable(IntEnum):
    """What is measured of a trial.

    A member is its own index on the last axis of every ``(..., 4)`` array, ``cells.mean[:, Observable.lift]``, and its
    name is the one in JSON, ``Observable["lift"]``.
    """

    column: str
    """Column of the trials table [SI]."""
    label: str
    """What a person calls it."""
    unit: str
    """SI unit."""
    usual_noise: float
    """Standard deviation of one trial [SI] that weighs observables against each other where nothing was replicated."""
    accuracy: tuple[float, float]
    """How well the tracking measures it, (constant [SI], share of the value): an error that all replicates share, so
    that they can't show it. Mean speed is a distance over a time and has none to speak of; the rise and the steepest
    slope of a folded curve have, as tests/unit/sandbot_tracking/test_trial.py bounds them on drawn truth."""

    def __new__(
        cls, index: int, column: str, label: str, unit: str, usual_noise: float, accuracy: tuple[float, float]
    ) -> Self:
        """The member of this index."""
        self = int.__new__(cls, index)
        self._value_ = index
        self.column, self.label, self.unit = column, label, unit
        self.usual_noise, self.accuracy = usual_noise, accuracy
        return self

    speed = 0, "speed_m_s", "mean speed", "m/s", 5e-3, (0.0, 0.0)
    lift = 1, "lift_m", "body lift", "m", 5e-4, (1e-4, 0.0)
    peak_speed = 2, "peak_speed_m_s", "peak speed", "m/s", 1e-2, (0.0, 0.015)
    first_step = 3, "first_step_m", "first step", "m", 1.5e-3, (3e-4, 0.0)

    @property
    def readers_unit(self) -> str:
        """The unit a person reads, ``CM`` times finer than SI."""
        return f"c{self.unit}"

    @property
    def heading(self) -> str:
        """Label and reader's unit, as over a column or beside an axis."""
        return f"{self.label} ({self.readers_unit})"


COLUMNS = tuple(observable.column for observable in Observable)
"""Columns of the trials table, in order."""
NAMES = tuple(observable.name for observable in Observable)
"""Names in JSON, in order."""
USUAL_NOISE = np.array([observable.usual_noise for observable in Observable])
"""``Observable.usual_noise``, ``(4,)``."""
