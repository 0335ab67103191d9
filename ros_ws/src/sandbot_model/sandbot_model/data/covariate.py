"""Trials corrected to the volume fraction of their level, by an analysis of covariance: y - ρ (∂y/∂φ)(φ - φ_level).

The bed misses its target by a little and φ is measured after every preparation, so this explains a good part of the
scatter of replicates. The slope comes from the cell means of neighbouring levels, not from any model; the reliability
ρ, the fraction of the measured deviation that is real and not noise of the height sensor, comes from the replicates.
"""

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints

SIGNIFICANT = 2.0
"""ρ below this many standard errors is taken to be 0."""


def local_slope(mean: Floats, keys: Ints, level_phi: Floats, walking: Bools) -> Floats:
    """∂(cell mean)/∂φ ``(cells, 4)`` between neighbouring levels; 0 where the cell swims or no neighbour walks.

    ``keys (3, cells)`` are level, gait and frequency index of each cell.
    """
    index = {tuple(key): cell for cell, key in enumerate(keys.T.tolist())}
    slope = np.zeros_like(mean)
    for (level, gait, frequency), cell in index.items():
        if not walking[cell]:
            continue
        neighbours = [index.get((level + step, gait, frequency)) for step in (-1, 1)]
        low, high = (cell if other is None or not walking[other] else other for other in neighbours)
        span = level_phi[keys[0, high]] - level_phi[keys[0, low]]
        if span > 0:
            slope[cell] = (mean[high] - mean[low]) / span
    return np.nan_to_num(slope)


def reliability(residual: Floats, expected: Floats) -> float:
    """ρ in [0, 1] from residuals about the cell mean and those expected from the measured φ, both ``(trials, 4)``."""
    usable = np.isfinite(residual) & (expected != 0)
    count = usable.sum(axis=0)
    square = np.where(usable, residual, 0.0) ** 2
    variance = np.divide(square.sum(axis=0), count, out=np.zeros(len(count)), where=count > 0)
    weight = np.where(usable & (variance > 0), 1.0 / np.where(variance > 0, variance, 1.0), 0.0)
    information = float(np.sum(weight * expected**2))
    if information <= 0:
        return 0.0
    rho = float(np.sum(weight * expected * np.nan_to_num(residual))) / information
    return float(np.clip(rho, 0.0, 1.0)) if rho > SIGNIFICANT / np.sqrt(information) else 0.0
