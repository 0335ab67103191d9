"""What a trial averages over: the bed's φ differs from trial to trial, and along the track.

G nodes x_g, w_g of Gauss-Hermite quadrature over k(φ), see ``likelihood``.
"""

import numpy as np

from sandbot_model.physics.arrays import Array
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Walker

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
NODES = _NODES
STEPS = 10
"""Steps over which a trial averages what varies along the track; about as many as four periods have."""


def along_the_track(walker: Walker) -> bool:
    """Whether an effect lets φ vary along the track."""
    return any(effect.along_the_track for effect in walker.effects)


def node_weights(values: Array, share: Array) -> Array:
    """Weight of each node (axis -2) in the mean of ``values (rows, cells, nodes, 4)`` where φ varies along the track,
    of nodes that each stand for a ``share (rows, cells, nodes)`` of the trials.

    A trial's lift is that of the median step and its peak that of the best one; its speed is the average still, as
    every step takes as long. Where trials alone differ in φ, all are averages over nodes, weighted by their share.
    """
    weights = np.repeat(share[..., None], len(Observable), axis=-1)
    weights[..., Observable.lift] = np.arange(len(NODES)) == len(NODES) // 2
    reached = np.where(np.abs(NODES) < 2, values[..., Observable.peak_speed], -np.inf)
    weights[..., Observable.peak_speed] = np.arange(len(NODES)) == reached.argmax(axis=-1)[..., None]
    return weights


def share_between_trials(along_the_track: bool, phi_scatter: float, track: Array) -> Array:
    """Standard deviation over trials as a share of that over steps, ``(rows or 1, cells or 1, 4)``.

    What varies along the track, by ``track (rows or 1, cells or 1)`` in φ, a trial averages over its steps; the first
    step happens once, and the best of all steps varies as much as a single step.
    """
    if not along_the_track:
        return np.ones((1, 1, 4))
    between = phi_scatter**2
    averaged = np.sqrt((between + track**2 / STEPS) / np.maximum(between + track**2, 1e-18))
    plain = np.ones_like(averaged)
    return np.stack([averaged, averaged, plain, plain], axis=-1)
