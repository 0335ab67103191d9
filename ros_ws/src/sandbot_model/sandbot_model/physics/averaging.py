"""What a trial averages over: the bed's φ differs from trial to trial, and along the track.

A fit averages over G nodes x_g, w_g of Gauss-Hermite quadrature over k(φ), see ``likelihood``.
"""

from dataclasses import replace
from statistics import NormalDist

import numpy as np

from sandbot_model.physics.arrays import Array
from sandbot_model.physics.observables import COLUMNS, Observable
from sandbot_model.physics.walking import Inputs, KCurve, Params, Prediction, Walker

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
NODES = _NODES
STEPS = 10
"""Steps over which a trial averages what varies along the track; about as many as four periods have."""
REACHED = 1.4
"""Deviation [σ of k] up to which one of these steps is the best: that of a node."""
MANY = 41
"""Places of a track that a prediction averages over. A fit moves a switch between its few nodes (``switch``); without
that they would say that 1, 23 or 77 % of the steps walk."""
K_PER_PHI = 5.0
"""dk/dφ over k where a single level determines no slope: 50 N/m over 0.05 at 200 N/m (Li09)."""
LEAST = 0.05
"""Of k, which no place is softer than."""
_PLACES = np.array([NormalDist().inv_cdf((place + 0.5) / MANY) for place in range(MANY)])
PLACES = _PLACES / _PLACES.std()
"""Each as probable as any other [σ of k]."""


def along_the_track(walker: Walker) -> bool:
    """Whether an effect lets φ vary along the track."""
    return any(effect.along_the_track for effect in walker.effects)


def slope_of(level_phi: Array, k: Array) -> Array:
    """dk/dφ at the levels [N/m], between neighbours, limited to about what poppy seeds show."""
    typical = K_PER_PHI * k
    if len(k) < 2:
        return np.asarray(typical)
    return np.asarray(np.clip(np.gradient(k, level_phi), 0.2 * typical, 3 * typical))


def predicted(walker: Walker, inputs: Inputs, params: Params, curve: KCurve) -> Prediction:
    """What a trial shows: as ``walker.predict``, along the track where an effect lets φ vary there, k with it.

    Depth, step and whether it walks are then the median step's. ``curve`` has one k a level.
    """
    if not along_the_track(walker):
        return walker.predict(inputs, params)
    k = np.asarray(inputs.k_n_per_m)
    slope = np.interp(np.asarray(inputs.phi, dtype=float), curve.phi, slope_of(curve.phi, curve.k_n_per_m))
    sigma_k = slope * walker.sigma_phi(inputs, params)
    steps = [walker.predict(replace(inputs, k_n_per_m=np.maximum(k + x * sigma_k, LEAST * k)), params) for x in PLACES]
    values = np.stack([step.observables for step in steps], axis=-2)
    weights = node_weights(values, np.full(values.shape[:-1], 1 / MANY), PLACES)
    averaged = np.moveaxis(np.sum(weights * values, axis=-2), -1, 0)
    return replace(steps[MANY // 2], **dict(zip(COLUMNS, averaged, strict=True)))


def node_weights(values: Array, share: Array, nodes: Array = NODES) -> Array:
    """Weight of each node (axis -2) in the mean of ``values (rows, cells, nodes, 4)`` where φ varies along the track,
    of ``nodes`` [σ of k] that each stand for a ``share (rows, cells, nodes)`` of the trials.

    A trial's lift is that of the median step and its peak that of the best one; its speed is the average still, as
    every step takes as long. Where trials alone differ in φ, all are averages over nodes, weighted by their share.
    """
    weights = np.repeat(share[..., None], len(Observable), axis=-1)
    weights[..., Observable.lift] = np.arange(len(nodes)) == len(nodes) // 2
    reached = np.where(np.abs(nodes) < REACHED, values[..., Observable.peak_speed], -np.inf)
    weights[..., Observable.peak_speed] = np.arange(len(nodes)) == reached.argmax(axis=-1)[..., None]
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
