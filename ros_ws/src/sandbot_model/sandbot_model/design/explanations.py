"""Candidate models (explanations) and their predictions for every trial that could be run."""

from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.design.places import Places
from sandbot_model.discovery.batch_sd import BATCH_SCALE, BATCH_ZERO, batch_sd_of
from sandbot_model.discovery.nuisances_about import ALONG, LIFT_ZERO, SPEED_SCALE
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import Estimate
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.observables import Observable

N_OBSERVABLES = len(Observable)


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation's predictions at ``n`` places, in standard deviations of one trial."""

    name: str
    mean: Floats
    """``(n, 4)``"""
    common: Floats
    """Covariance between places ``(n, 4, n, 4)`` from the parameters' uncertainty and from errors that trials share."""

    def of(self, trials: Floats) -> tuple[Floats, Floats]:
        """Mean ``(..., 4t)`` and covariance ``(..., 4t, 4t)`` of trials at places ``trials (..., t)``."""
        count = trials.shape[-1]
        common = self.common[trials[..., :, None], :, trials[..., None, :], :]
        size = N_OBSERVABLES * count
        joint = np.moveaxis(common, -2, -3).reshape(*trials.shape[:-1], size, size)
        return self.mean[trials].reshape(*trials.shape[:-1], -1), joint + np.eye(size)


def explained_by(fit: Fit, places: Places) -> Explanation:
    """The predictions of a fit."""
    precision = places.precision
    zero_m, scale = zero_and_scale(fit)
    at = places.phi, places.omega, places.clock
    expected = readings(fit, *at)
    errors = np.concatenate([fit.deviations(*at), reading_errors(expected, zero_m.stderr, scale.stderr)])
    # Near a switch, linearised errors may exceed those of the mean that has been measured: they are limited to these.
    errors *= precision * np.sqrt(np.minimum(1.0, places.known / np.maximum(np.sum(errors**2, axis=0), 1e-300)))
    return Explanation(
        name=name_of(fit),
        mean=np.asarray(expected * precision),
        common=np.einsum("api,aqj->piqj", errors, errors) + _diagonal(places.shared * precision**2),
    )


def name_of(fit: Fit) -> str:
    """The effects of a fit; in words if it has none."""
    return " + ".join(fit.effects) or "the base model"


def readings(fit: Fit, phi: Floats, omega: Floats, clock: Clock | None = None) -> Floats:
    """Expected readings at ``n`` places ``(n, 4)``, with the fitted lift zero and speed scale."""
    predicted = np.nan_to_num(fit.predict(phi, omega, clock).observables)
    zero_m, scale = zero_and_scale(fit)
    return np.asarray(predicted + reading_errors(predicted, zero_m.value, scale.value).sum(axis=0))


def zero_and_scale(fit: Fit) -> tuple[Estimate, Estimate]:
    """Lift zero [m] and relative speed scale error of future trials: as fitted, else zero with the cameras' accuracy;
    where batches differ, the next batch has its own."""
    accuracy = fit.cells.accuracy
    unknown = Estimate(0.0, accuracy.lift_zero_m), Estimate(0.0, accuracy.speed_scale)
    if fit.nuisances is None:
        return unknown
    found, batch_sd = dict(zip(fit.nuisances.names, fit.shared, strict=True)), batch_sd_of(fit)
    zero, scale = found.get(LIFT_ZERO, unknown[0]), found.get(SPEED_SCALE, unknown[1])
    return (
        Estimate(zero.value, float(np.hypot(zero.stderr, batch_sd[BATCH_ZERO]))),
        Estimate(scale.value, float(np.hypot(scale.stderr, batch_sd[BATCH_SCALE]))),
    )


def reading_errors(predicted: Floats, zero_m: float, scale: float) -> Floats:
    """Changes of ``predicted (n, 4)`` by a lift zero and by a speed scale ``(2, n, 4)``."""
    errors = np.zeros((2, *predicted.shape))
    errors[0, :, Observable.lift] = zero_m
    errors[1][:, ALONG] = scale * predicted[:, ALONG]
    return errors


def _diagonal(variance: Floats) -> Floats:
    """Covariance ``(n, 4, n, 4)`` of independent errors with variances ``(n, 4)``."""
    return np.diag(variance.ravel()).reshape(*variance.shape, *variance.shape)
