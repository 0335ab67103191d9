"""Rows of two tables that agree in every value both give, to the digits both give: as one trial written twice does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats
from sandbot_record.trials.table import CONDITION, MEASURED, Row

_VALUES = (*CONDITION, *MEASURED)
_SPEED = _VALUES.index("speed_m_s")
_MOST_DIGITS = 9
"""Digits that count: unit conversion changes the last of 16."""
_LEAST = 2
"""Decimals and digits that every column has, though zeros at their end are not seen: 0.60, 20."""


@dataclass(frozen=True)
class Written:
    """Rows as arrays: values of shape (n, 6), the steps to which they were rounded, gaits; NaN and "": not given."""

    values: Floats
    steps: Floats
    gaits: NDArray[np.str_]

    @classmethod
    def of(cls, rows: Sequence[Row]) -> "Written":
        """The rows of one table, whose values of a column were rounded alike."""
        values = np.array([[getattr(row, name) for name in _VALUES] for row in rows]).reshape(-1, len(_VALUES))
        steps = np.array([_steps(column) for column in values.T]).T
        return cls(values, steps, np.array([row.gait for row in rows], dtype=np.str_))

    def select(self, which: NDArray[np.int_] | slice) -> "Written":
        """The rows selected by indices."""
        return Written(self.values[which], self.steps[which], self.gaits[which])


def agreeing(first: Written, second: Written) -> list[tuple[int, int]]:
    """Indices of pairs of a row and one of another table that agree; each row has a speed and occurs at most once."""
    order = np.argsort(second.values[:, _SPEED], kind="stable")
    speeds = second.values[order, _SPEED]
    widest = second.steps[:, _SPEED].max(initial=0.0)
    free = np.ones(len(order), dtype=bool)
    found = []
    for at, (speed, step) in enumerate(zip(first.values[:, _SPEED], first.steps[:, _SPEED], strict=True)):
        reach = max(step, widest)
        near = order[np.searchsorted(speeds, speed - reach) : np.searchsorted(speeds, speed + reach)]
        near = near[free[near]]
        if near.size and (near := near[agree(first.select(slice(at, at + 1)), second.select(near))]).size:
            free[near.min()] = False
            found.append((at, int(near.min())))
    return found


def agree(first: Written, second: Written) -> NDArray[np.bool_]:
    """Whether each row agrees with that of the other table at the same index, or with its only one; shape (n,)."""
    # A little more than half a step, because a tie may be rounded either way. NaN differs from nothing.
    within = 0.501 * np.fmax(first.steps, second.steps)
    differ = (np.abs(first.values - second.values) > within).any(axis=1)
    gaits_differ = (first.gaits != second.gaits) & (first.gaits != "") & (second.gaits != "")
    return np.asarray(~(differ | gaits_differ))


def _steps(column: Floats) -> Floats:
    """The step to which each value of a column was rounded, to as many decimals or digits as any value of it has."""
    texts = [f"{abs(value):.{_MOST_DIGITS - 1}e}".partition("e") for value in np.nan_to_num(column)]
    exponents = np.array([int(exponent) for *_, exponent in texts], dtype=int)
    digits = np.array([len(digits.replace(".", "").rstrip("0")) for digits, *_ in texts], dtype=int)
    decimals = np.max(digits - 1 - exponents, initial=_LEAST)
    places = np.minimum(decimals, np.max(digits, initial=_LEAST) - 1 - exponents)
    return np.where(np.isnan(column), np.nan, 10.0**-places)
