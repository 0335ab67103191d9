"""What a plan would show if all of it were run."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.design.explanations import reading_errors
from sandbot_model.design.places import Places
from sandbot_model.discovery.next_trials import SETTLED_SD
from sandbot_model.fitting.fit import Fit


def gains_over(named: Fit, places: Places, replicates: int) -> Callable[[Fit], float]:
    """A function of another fit: the rise of the deviance from ``named`` to it that is expected after ``replicates``
    trials at every place, less what the unknowns of ``named`` and the readings' zero and scale can absorb.

    Each gap counts for at most ``SETTLED_SD``: where one fit walks and the other swims, the switch is not known well.
    """
    error = np.sqrt(places.noise / replicates + places.shared)
    expected, accuracy = _predicted(named, places), named.cells.accuracy
    # Along axes: as many directions as unknowns, where the points of a sample would absorb any gap.
    along = replace(named, sample=None).deviations(places.phi, places.omega, places.clock)
    free = (along / error).reshape(-1, expected.size)
    prior = (reading_errors(expected, accuracy.lift_zero_m, accuracy.speed_scale) / error).reshape(-1, expected.size)

    def gain(other: Fit) -> float:
        gap = np.clip((_predicted(other, places) - expected) / error, -SETTLED_SD, SETTLED_SD).ravel()
        return _unabsorbed(gap, free, prior)

    return gain


def _predicted(fit: Fit, places: Places) -> Floats:
    return np.nan_to_num(fit.predict(places.phi, places.omega, places.clock).observables)


def _unabsorbed(gap: Floats, free: Floats, prior: Floats) -> float:
    """Least |gap - aᵀ free - bᵀ prior|² + |b|²."""
    priors = np.eye(len(free) + len(prior))[len(free) :]
    slopes = np.concatenate([np.concatenate([free, prior]).T, priors])
    target = np.concatenate([gap, np.zeros(len(prior))])
    found = np.linalg.lstsq(slopes, target, rcond=1e-9)[0]
    return float(np.sum((target - slopes @ found) ** 2))
