"""The conditions a campaign starts with, before anything is known: spread evenly over the plan's grid."""

from collections.abc import Sequence

import numpy as np

Condition = tuple[float, float]
"""φ and ω [rad/s]."""
VISITS = 2
"""Fewest visits of each level of φ and of each ω: a level has one unknown k, which a second ω tests."""


def start(phi: Sequence[float], omega_rad_s: Sequence[float]) -> list[Condition]:
    """Conditions of the grid that include each φ and ω at least ``VISITS`` times, chosen one by one: first where both
    still lack visits, then where there have been fewest, then farthest from those chosen.
    """
    rows, columns = (axis.ravel() for axis in np.indices((len(phi), len(omega_rad_s))))
    at = np.stack([_spread(phi)[rows], _spread(omega_rad_s)[columns]], axis=-1)
    chosen: list[int] = []
    while True:
        # A row has no more visits to offer than it has conditions.
        by_row = np.bincount(rows[chosen], minlength=len(phi))
        by_column = np.bincount(columns[chosen], minlength=len(omega_rad_s))
        wanted = (by_row < min(VISITS, len(omega_rad_s)))[rows] * 1 + (by_column < min(VISITS, len(phi)))[columns]
        taken = np.isin(np.arange(len(at)), chosen)
        if not wanted[~taken].any():
            return [(float(phi[rows[i]]), float(omega_rad_s[columns[i]])) for i in sorted(chosen)]
        visits = by_row[rows] + by_column[columns]
        distance = np.min([np.linalg.norm(at - at[i], axis=-1) for i in chosen] or [np.abs(at).sum(axis=1)], axis=0)
        chosen.append(int(np.lexsort((-distance, visits, -wanted, taken))[0]))


def _spread(values: Sequence[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Levels from -1 to 1, in proportion."""
    given = np.asarray(values, dtype=float)
    span = float(np.ptp(given))
    return 2 * (given - given.min()) / span - 1 if span > 0 else np.zeros(len(given))
