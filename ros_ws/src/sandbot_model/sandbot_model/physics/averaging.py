"""Averages over φ, which scatters from trial to trial and varies along the track.

A fit averages over k(φ) with G nodes x_g, w_g of Gauss-Hermite quadrature, see ``likelihood``.
"""

from dataclasses import replace
from statistics import NormalDist

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.physics.observables import COLUMNS, Observable
from sandbot_model.physics.walking import Inputs, KCurve, Params, Prediction, Walker

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
NODES = _NODES
STEPS = 10
"""Number of steps over which a trial averages a variation along the track; about that of four periods."""
REACHED = 1.4
"""Greatest deviation [σ of k] that the best of these steps is expected to reach, a node's."""
PLACES_COUNT = 41
"""Places along a track that a prediction averages over. Few nodes would not do: 1, 23 or 77 % of the steps would walk,
which a fit avoids by locating the switch between its nodes (``switch``)."""
K_PER_PHI = 5.0
"""dk/dφ over k, used where a single level gives no slope: 50 N/m over 0.05 at 200 N/m (Li09)."""
LEAST_K = 0.05
"""Least stiffness of a place, as a fraction of k."""
_PLACES = np.array([NormalDist().inv_cdf((place + 0.5) / PLACES_COUNT) for place in range(PLACES_COUNT)])
PLACES = _PLACES / _PLACES.std()
"""Deviations [σ of k] of equally probable places."""


def along_the_track(walker: Walker) -> bool:
    """Whether an effect lets φ vary along the track."""
    return any(effect.along_the_track for effect in walker.effects)


def slope_of(level_phi: Floats, k: Floats) -> Floats:
    """dk/dφ [N/m] at the levels ``(levels,)`` from k [N/m] of neighbours, limited to about what poppy seeds show."""
    typical = K_PER_PHI * k
    if len(k) < 2:
        return np.asarray(typical)
    return np.asarray(np.clip(np.gradient(k, level_phi), 0.2 * typical, 3 * typical))


def predicted(walker: Walker, inputs: Inputs, params: Params, curve: KCurve) -> Prediction:
    """The observables of ``walker.predict``, averaged along the track where an effect lets φ vary there.

    Depth, step and whether the robot walks are then the median step's. ``curve`` has one k per level.
    """
    if not along_the_track(walker):
        return walker.predict(inputs, params)
    k = np.asarray(inputs.k_n_per_m)
    slope = np.interp(np.asarray(inputs.phi, dtype=float), curve.phi, slope_of(curve.phi, curve.k_n_per_m))
    sigma_k = slope * walker.sigma_phi(inputs, params)
    ks = [np.maximum(k + x * sigma_k, LEAST_K * k) for x in PLACES]
    steps = [walker.predict(replace(inputs, k_n_per_m=each), params) for each in ks]
    values = np.stack([step.observables for step in steps], axis=-2)
    weights = node_weights(values, np.full(values.shape[:-1], 1 / PLACES_COUNT), PLACES)
    averaged = np.moveaxis(np.sum(weights * values, axis=-2), -1, 0)
    return replace(steps[PLACES_COUNT // 2], **dict(zip(COLUMNS, averaged, strict=True)))


def node_weights(values: Floats, share: Floats, nodes: Floats = NODES) -> Floats:
    """Weight of each node (axis -2) in the mean of ``values (rows, cells, nodes, 4)`` where φ varies along the track;
    ``nodes`` [σ of k] each represent a ``share (rows, cells, nodes)`` of the trials.

    A trial's lift is that of the median step and its peak speed that of the best step; its speed is the average, since
    all steps take equally long. Where φ differs between trials only, all are averages weighted by ``share``.
    """
    weights = np.repeat(share[..., None], len(Observable), axis=-1)
    weights[..., Observable.lift] = np.arange(len(nodes)) == len(nodes) // 2
    reached = np.where(np.abs(nodes) < REACHED, values[..., Observable.peak_speed], -np.inf)
    weights[..., Observable.peak_speed] = np.arange(len(nodes)) == reached.argmax(axis=-1)[..., None]
    return weights


def share_between_trials(along_the_track: bool, phi_scatter: float, track: Floats) -> Floats:
    """Standard deviation over trials as a fraction of that over steps, ``(rows or 1, cells or 1, 4)``.

    A trial averages the variation of φ along the track, of sd ``track (rows or 1, cells or 1)``, over its steps; but
    there is only one first step, and the peak speed varies as much as that of a single step.
    """
    if not along_the_track:
        return np.ones((1, 1, len(Observable)))
    between = phi_scatter**2
    averaged = np.sqrt((between + track**2 / STEPS) / np.maximum(between + track**2, 1e-18))
    single = (Observable.peak_speed, Observable.first_step)
    return np.stack([np.ones_like(averaged) if one in single else averaged for one in Observable], axis=-1)
