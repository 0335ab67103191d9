"""What may still be true, and what it predicts of every trial that could be run."""

from dataclasses import dataclass

import numpy as np

from sandbot_model.design.places import Places
from sandbot_model.discovery.batch_sd import BATCH_SCALE, BATCH_ZERO, batch_sd_of
from sandbot_model.discovery.nuisances_about import ALONG, LIFT_ZERO, SPEED_SCALE
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import Estimate
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.observables import Observable

MANY = len(Observable)


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation's predictions at ``n`` places, in standard deviations of one trial."""

    name: str
    mean: Array
    """``(n, 4)``"""
    common: Array
    """Covariance between places, of what is not known and what trials share, ``(n, 4, n, 4)``."""

    def of(self, trials: Array) -> tuple[Array, Array]:
        """Mean ``(..., 4t)`` and covariance ``(..., 4t, 4t)`` of trials at places ``trials (..., t)``."""
        count = trials.shape[-1]
        common = self.common[trials[..., :, None], :, trials[..., None, :], :]
        joint = np.moveaxis(common, -2, -3).reshape(*trials.shape[:-1], MANY * count, MANY * count)
        return self.mean[trials].reshape(*trials.shape[:-1], -1), joint + np.eye(MANY * count)


def explained_by(fit: Fit, places: Places) -> Explanation:
    """What a fit predicts."""
    precision = places.precision
    zero_m, scale = read_with(fit)
    at = places.phi, places.omega, places.clock
    read = readings(fit, *at)
    off = np.concatenate([fit.deviations(*at), readings_off(read, zero_m.stderr, scale.stderr)])
    # Beside a switch parameters seem to leave open what trials have settled.
    off *= precision * np.sqrt(np.minimum(1.0, places.known / np.maximum(np.sum(off**2, axis=0), 1e-300)))
    return Explanation(
        name=name_of(fit),
        mean=np.asarray(read * precision),
        common=np.einsum("api,aqj->piqj", off, off) + _diagonal(places.shared * precision**2),
    )


def name_of(fit: Fit) -> str:
    """The effects that it has, in words where it has none."""
    return " + ".join(fit.effects) or "the base model"


def readings(fit: Fit, phi: Array, omega: Array, clock: Clock | None = None) -> Array:
    """What will be read at ``n`` places ``(n, 4)``, with the lift zero and the speed scale that the fit has found."""
    predicted = np.nan_to_num(fit.predict(phi, omega, clock).observables)
    zero_m, scale = read_with(fit)
    return np.asarray(predicted + readings_off(predicted, zero_m.value, scale.value).sum(axis=0))


def read_with(fit: Fit) -> tuple[Estimate, Estimate]:
    """Lift zero [m] and speed scale of trials to come: as they were found, else as well as the cameras' file knows
    them; the next batch has its own, where batches differ."""
    accuracy = fit.cells.accuracy
    unknown = Estimate(0.0, accuracy.lift_zero_m), Estimate(0.0, accuracy.speed_scale)
    if fit.nuisances is None:
        return unknown
    found, apart = dict(zip(fit.nuisances.names, fit.shared, strict=True)), batch_sd_of(fit)
    zero, scale = found.get(LIFT_ZERO, unknown[0]), found.get(SPEED_SCALE, unknown[1])
    return (
        Estimate(zero.value, float(np.hypot(zero.stderr, apart[BATCH_ZERO]))),
        Estimate(scale.value, float(np.hypot(scale.stderr, apart[BATCH_SCALE]))),
    )


def readings_off(predicted: Array, zero_m: float, scale: float) -> Array:
    """What a lift zero and a speed scale change in ``predicted (n, 4)``, ``(2, n, 4)``."""
    off = np.zeros((2, *predicted.shape))
    off[0, :, Observable.lift] = zero_m
    off[1][:, ALONG] = scale * predicted[:, ALONG]
    return off


def _diagonal(variance: Array) -> Array:
    """Covariance ``(n, 4, n, 4)`` of errors that nothing else shares, of variances ``(n, 4)``."""
    return np.diag(variance.ravel()).reshape(*variance.shape, *variance.shape)
