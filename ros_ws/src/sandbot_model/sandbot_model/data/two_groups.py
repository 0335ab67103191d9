"""The split of trials, in the order of the table or of their runs, that best separates replicates into two groups.

Two robots in one table differ in every condition, by amounts that depend on it: each group has means of its own there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Bools, Floats, Ints

FAR_APART = 5.0
"""Ratio of the scatter of replicates to a lab's beyond which it is questioned; a k that jumps by 3 % gives less."""
AGREEING = 2
"""Observables in which it must be."""
LEAST_DOF = 8
"""Degrees of freedom within groups and conditions below which groups may agree by chance."""


@dataclass(frozen=True, eq=False)
class TwoGroups:
    """Where trials are split: after ``last`` and before ``first`` (trial ids), with the standard deviation ``sd (4,)``
    of one trial within groups and conditions [SI]; NaN where too few replicates tell it.
    """

    last: str
    first: str
    sd: Floats


def far_apart(noise: Floats, usual: Floats) -> Bools:
    """In which observables ``(4,)`` replicates scatter suspiciously more than is ``usual`` in a lab."""
    return noise > FAR_APART * usual


def two_groups(residual: Floats, cell: Ints, names: NDArray[np.str_], run_order: Floats) -> TwoGroups | None:
    """The split that removes the largest fraction of the variance of residuals ``(trials, 4)`` about the means of their
    ``cell (trials,)``, averaged over observables. Both orders are tried; None where no split removes any.
    """
    orders = [np.arange(len(cell))]
    if np.isfinite(run_order).all():
        orders.append(np.argsort(run_order, kind="stable"))
    best, found = 0.0, None
    for order in orders:
        variance = np.stack([_within(column, cell[order]) for column in residual[order].T], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            removed = 1 - variance[1:-1] / variance[0]
        share = np.where(np.isfinite(removed), removed, 0.0).mean(axis=1)
        if len(share) and share.max() > best:
            best, at = float(share.max()), int(share.argmax()) + 1
            found = TwoGroups(str(names[order[at - 1]]), str(names[order[at]]), np.sqrt(variance[at]))
    return found


def _within(column: Floats, cell: Ints) -> Floats:
    """Variance within conditions and groups ``(trials + 1,)`` if the first 0, 1, 2, … trials are the one group.

    Moving a trial to the other group changes the means of its own cell only, so all splits together cost one pass.
    """
    measured = np.isfinite(column)
    explained, groups = np.zeros((2, len(column) + 1))
    for this_cell in np.unique(cell[measured]):
        inside = np.flatnonzero((cell == this_cell) & measured)
        before, n = np.cumsum(column[inside]), np.arange(1, len(inside) + 1)
        after, rest = before[-1] - before, len(inside) - n
        squares = [before[-1] ** 2 / len(inside), *(before**2 / n + after**2 / np.maximum(rest, 1))]
        explained[0] += squares[0]
        explained[inside + 1] += np.diff(squares)
        groups[[0, inside[0] + 1]] += 1
        groups[inside[-1] + 1] -= 1
    dof = measured.sum() - np.cumsum(groups)
    left = np.sum(column[measured] ** 2) - np.cumsum(explained)
    return np.where(dof >= LEAST_DOF, np.maximum(left, 0.0) / np.maximum(dof, 1), np.nan)
