"""The conditions a campaign starts with, before anything is known: spread evenly over the plan's grid."""

from collections.abc import Sequence

import numpy as np

Condition = tuple[float, float]
"""φ and ω [rad/s]."""
VISITS = 2
"""How often each level of φ and each ω is visited at least: k is one unknown a level, a second ω tests it."""


def start(phi: Sequence[float], omega_rad_s: Sequence[float]) -> list[Condition]:
    """Conditions of the grid among which each φ and each ω is ``VISITS`` times or more: one after the other, first
    where both are wanted, then where they have been visited least, then farthest from those before.
    """
    rows, columns = (axis.ravel() for axis in np.indices((len(phi), len(omega_rad_s))))
    at = np.stack([_spread(phi)[rows], _spread(omega_rad_s)[columns]], axis=-1)
    chosen: list[int] = []
    while True:
        # A row that is visited everywhere can't be visited more.
        by_row = np.bincount(rows[chosen], minlength=len(phi))
        by_column = np.bincount(columns[chosen], minlength=len(omega_rad_s))
        wanted = (by_row < min(VISITS, len(omega_rad_s)))[rows] * 1 + (by_column < min(VISITS, len(phi)))[columns]
        taken = np.isin(np.arange(len(at)), chosen)
        if not wanted[~taken].any():
            return [(float(phi[rows[one]]), float(omega_rad_s[columns[one]])) for one in sorted(chosen)]
        visits = by_row[rows] + by_column[columns]
        away = np.min([np.linalg.norm(at - at[one], axis=-1) for one in chosen] or [np.abs(at).sum(axis=1)], axis=0)
        chosen.append(int(np.lexsort((-away, visits, -wanted, taken))[0]))


def _spread(values: Sequence[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Levels from -1 to 1, in proportion."""
    given = np.asarray(values, dtype=float)
    span = float(np.ptp(given))
    return 2 * (given - given.min()) / span - 1 if span > 0 else np.zeros(len(given))
