"""Rows of a table that are the means of others, as spreadsheets add them: read as trials, they would be replicates that
scatter too little, or a condition that was never run.
"""

from decimal import Decimal

import numpy as np

from sandbot_common.arrays import Floats, Ints

BY_CHANCE = 1e-3
"""Rows are means, not trials, if chance makes so many of them equal the means of others less often than this."""
LEAST_ROWS = 4
"""Rows from which one can be the mean of all others."""


def means_of_cells(values: Floats, cell: Ints) -> list[int]:
    """Rows of ``values (n, m)``, NaN where not measured, that equal the mean of the others of their ``cell (n,)``: one
    of every cell with replicates; none if a cell has no such row, or if chance explains them.
    """
    step, cells = _steps(values), [np.flatnonzero(cell == one) for one in np.flatnonzero(np.bincount(cell) > 1)]
    scatter = [_sd(values[inside]) for inside in cells]
    squares = np.square(scatter).reshape(-1, values.shape[1])
    pooled = np.sqrt(np.nansum(squares, axis=0) / np.maximum(np.isfinite(squares).sum(axis=0), 1))
    found, chance = [], 1.0
    for inside, own in zip(cells, scatter, strict=True):
        misses = _misses(values[inside], step)
        if misses.min() > 1.0:
            return []
        found.append(int(inside[misses.argmin()]))
        # A cell of swimmers may scatter less than others. Observables of a trial may be off together: one counts.
        chance *= min(1.0, len(inside) * float(np.nanmin(_chance(step, np.fmin(own, pooled)))))
    return found if chance < BY_CHANCE else []


def mean_of_columns(settings: Floats, values: Floats) -> int | None:
    """The first or last row if it equals the mean of all others in every column of ``settings (n, 2)``, φ and ω, and of
    ``values (n, m)``, and chance does not explain it.
    """
    columns = np.concatenate([settings, values], axis=1)
    step = _steps(columns)
    misses, chance = _misses(columns, step), _chance(step, _sd(columns))
    for row in (len(columns) - 1, 0) if len(columns) >= LEAST_ROWS else ():
        # A design may well have conditions in its middle.
        shared = np.count_nonzero(np.abs(settings - settings[row]) < step[:2], axis=0) > 1
        set_so = np.where(shared, 1.0, chance[:2]).min()
        if misses[row] <= 1.0 and 2 * set_so * np.nanmin(chance[2:]) < BY_CHANCE:
            return row
    return None


def _misses(rows: Floats, step: Floats) -> Floats:
    """Largest difference of each row ``(n,)`` from the mean of the others, in steps: up to 1 if it is their mean, with
    both rounded."""
    seen = np.isfinite(rows)
    with np.errstate(invalid="ignore", divide="ignore"):
        others = (np.nansum(rows, axis=0) - np.nan_to_num(rows)) / (seen.sum(axis=0) - seen)
    return np.asarray(np.nan_to_num(np.abs(rows - others) / step).max(axis=1) / (1 + 1e-6))


def _chance(step: Floats, scatter: Floats) -> Floats:
    """Chance that a trial equals the mean of others to a step either way, at most: a normal density at its peak."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.minimum(3 * step / (np.sqrt(2 * np.pi) * scatter), 1.0))


def _sd(rows: Floats) -> Floats:
    """Scatter ``(m,)`` of the rows; NaN where there are not two."""
    seen = np.isfinite(rows)
    n = np.maximum(seen.sum(axis=0), 1)
    about = np.where(seen, rows - np.nansum(rows, axis=0) / n, 0.0)
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.where(n > 1, (about**2).sum(axis=0) / (n - 1), np.nan))


def _steps(values: Floats) -> Floats:
    """Steps ``(m,)`` to which the columns are written: the median counts, as some values end in zeros."""
    return np.array([10.0 ** -np.median([_decimals(value) for value in of[np.isfinite(of)]] or [0]) for of in values.T])


def _decimals(value: float) -> int:
    """Decimals among nine digits: conversion of units changes the last ones."""
    return -int(Decimal(f"{value:.9g}").normalize().as_tuple().exponent)
