"""What a plan would show if the whole of it were run."""

from collections.abc import Callable

import numpy as np

from sandbot_model.design.explanations import readings_off
from sandbot_model.design.places import Places
from sandbot_model.discovery.next_trials import SETTLED_SD
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.arrays import Array


def gains_over(named: Fit, places: Places, replicates: int) -> Callable[[Fit], float]:
    """Rise of the deviance from a fit to another that is expected once every place has had ``replicates`` trials, less
    what the unknowns of the first and the readings' zero and scale can absorb.

    A place where one walks and the other swims counts for ``SETTLED_SD``: how near the switch is, nobody knows well.
    """
    error = np.sqrt(places.noise / replicates + places.shared)
    read, accuracy = _read(named, places), named.cells.accuracy
    free = (named.deviations(places.phi, places.omega, places.clock) / error).reshape(-1, read.size)
    prior = (readings_off(read, accuracy.lift_zero_m, accuracy.speed_scale) / error).reshape(-1, read.size)

    def gain(other: Fit) -> float:
        gap = np.clip((_read(other, places) - read) / error, -SETTLED_SD, SETTLED_SD).ravel()
        return _left(gap, free, prior)

    return gain


def _read(fit: Fit, places: Places) -> Array:
    return np.nan_to_num(fit.predict(places.phi, places.omega, places.clock).observables)


def _left(gap: Array, free: Array, prior: Array) -> float:
    """Least |gap - aᵀ free - bᵀ prior|² + |b|²."""
    priors = np.eye(len(free) + len(prior))[len(free) :]
    slopes = np.concatenate([np.concatenate([free, prior]).T, priors])
    target = np.concatenate([gap, np.zeros(len(prior))])
    found = np.linalg.lstsq(slopes, target, rcond=1e-9)[0]
    return float(np.sum((target - slopes @ found) ** 2))
