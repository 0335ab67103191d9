"""Clustering of measured values that scatter about a few targets into levels."""

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats, Ints

MOST_LEVELS = 40
SMALLEST_SCATTER = 2.5e-4
"""Scatter of φ [1] below which replicates count as one value."""
WIDEST_SCATTER = 2e-3
"""Scatter of φ beyond which trials are not replicates, whatever was intended: a bed meets its target to 0.0005 or
0.001, and over a wider range the ground differs."""
OMEGA_TOLERANCE = 5e-3
"""Leg frequencies closer than this (relative) are the same condition."""


def conditions(phi: Floats, gait: NDArray[np.str_], omega: Floats) -> tuple[Ints, Ints]:
    """The condition of each trial ``(n,)``, and each condition's (φ level, gait, ω) as indices ``(3, conditions)``.

    Conditions are sorted by these; gaits are numbered by name, ω from the lowest.
    """
    index = np.unique(np.asarray(gait, dtype=str), return_inverse=True)[1]
    keys = np.stack([phi_levels(phi), index, same_within(omega, OMEGA_TOLERANCE)])
    found, condition = np.unique(keys, axis=1, return_inverse=True)
    return condition.ravel(), found


def phi_levels(phi: Floats) -> Ints:
    """The level of each measured volume fraction ``(n,)``, counted from the loosest.

    Optimal one-dimensional k-means for each number of levels (dynamic programming on a histogram of 10⁻⁴), the number
    chosen by the Bayesian information criterion with a common scatter. It copes with beds that missed their target a
    little, and with levels 0.003 apart that scatter by 0.0007, where a fixed gap fails. No level scatters by more than
    ``WIDEST_SCATTER``: where φ is reproduced badly, or each trial has its own, levels are classes of φ.
    """
    values, inverse, counts = np.unique(np.round(phi, 4), return_inverse=True, return_counts=True)
    most = min(MOST_LEVELS, len(values))
    cost = _cost(values, counts.astype(float))
    best = cost[0].copy()
    back = np.zeros((most, len(values)), dtype=np.int64)
    sums = [best[-1]]
    for level in range(1, most):
        # best[j] of `level + 1` groups = min over i of best[i - 1] of `level` groups + cost of i..j in one group.
        total = np.concatenate([[np.inf], best[:-1]])[:, None] + cost
        back[level] = total.argmin(axis=0)
        best = total.min(axis=0)
        sums.append(best[-1])
    partitions = [_groups(back, last, len(values))[inverse] for last in range(most)]
    scores = [_criterion(total, groups) for total, groups in zip(sums, partitions, strict=True)]
    narrow = np.array([widest_scatter(phi, groups) <= WIDEST_SCATTER for groups in partitions])
    narrow[-1] = True
    return partitions[int(np.argmin(np.where(narrow, scores, np.inf)))]


def same_within(values: Floats, tolerance: float) -> Ints:
    """The index ``(n,)`` of each value among the distinct ones; steps below a relative tolerance count as equal."""
    order = np.argsort(values)
    step = np.diff(values[order]) > tolerance * np.abs(values[order][1:])
    group = np.empty(len(values), dtype=np.int64)
    group[order] = np.concatenate([[0], np.cumsum(step)])
    return group


def frequencies(omega: Floats) -> Floats:
    """The distinct leg frequencies [rad/s] of trials ``(n,)``, ascending: means of those of one condition, to 0.001."""
    group = same_within(omega, OMEGA_TOLERANCE)
    return np.asarray(np.round(np.bincount(group, omega) / np.bincount(group), 3))


def _criterion(squares: float, groups: Ints) -> float:
    """-2 ln classification likelihood + 3 K ln n: the entropy of the partition keeps one level from being split."""
    n, counts = len(groups), np.bincount(groups)
    scatter = n * np.log(squares / n + SMALLEST_SCATTER**2)
    return float(scatter - 2 * np.sum(counts * np.log(counts / n)) + 3 * len(counts) * np.log(n))


def widest_scatter(phi: Floats, groups: Ints) -> float:
    """Standard deviation of φ in the group where it is largest."""
    count = np.bincount(groups)
    deviation = phi - (np.bincount(groups, phi) / count)[groups]
    return float(np.sqrt((np.bincount(groups, deviation**2) / count).max()))


def _cost(values: Floats, weights: Floats) -> Floats:
    """Sum of squares of values i..j about their mean ``(n, n)``, infinite for i > j."""
    centred = values - values.mean()
    weight, first, second = (
        np.concatenate([[0.0], np.cumsum(weights * power)]) for power in (1.0, centred, centred**2)
    )

    def between(total: Floats) -> Floats:
        return np.asarray(total[1:][None, :] - total[:-1][:, None])

    count = between(weight)
    with np.errstate(invalid="ignore", divide="ignore"):
        cost = between(second) - between(first) ** 2 / count
    return np.where(count > 0, np.maximum(cost, 0.0), np.inf)


def _groups(back: Ints, last_level: int, n: int) -> Ints:
    group, end = np.zeros(n, dtype=np.int64), n
    for level in range(last_level, -1, -1):
        start = int(back[level][end - 1]) if level else 0
        group[start:end] = level
        end = start
    return group
