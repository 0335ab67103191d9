"""The calibration error that would overturn a verdict: a zero or scale that explains as much as an effect."""

from dataclasses import replace

import numpy as np

from sandbot_model.discovery.batch_sd import ALIKE, BatchSd, batch_sd_of
from sandbot_model.discovery.effect_search import EffectSearch, once_per_search
from sandbot_model.discovery.nuisances_about import LIFT_SCALE, LIFT_ZERO, SPEED_SCALE, nuisances_for
from sandbot_model.discovery.nuisances_in_words import in_words
from sandbot_model.discovery.sharing import FAR_OFF
from sandbot_model.discovery.verdict import claim_threshold, leaves_nothing, parts_of
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import Observable

FREE = 1e3
"""Factor on a prior's standard deviation that makes it uninformative."""
READINGS = {LIFT_ZERO: "zero of the lift", SPEED_SCALE: "scale along the track"}
REPEATED = 2
"""Number of fits with a free scale of the lift."""
Miscalibration = tuple[str, float, float, float]
"""Name of a zero or scale, its fitted error, the standard error of that, and its prior standard deviation."""


def rival_calibration_error(search: EffectSearch, named: Fit) -> str:
    """One clause: the smallest calibration error, relative to its prior, that explains as much as a named effect; empty
    if there is no zero or scale to be wrong. A scale of the lift is no nuisance, but looks like a loss of speed."""
    free, enough = _rivals(search, named)
    if not enough:
        scaled = _with_lift_scale(search, *_beside(search, named))
        enough = [error for fit, error in scaled if _explains_as_much(search, fit, named)]
    if enough:
        return f"{in_words(*min(enough, key=_in_priors))} would explain as much"
    return f"no error in the {' or the '.join(READINGS[name] for name, *_ in free)} explains as much" if free else ""


def has_rival(search: EffectSearch, named: Fit) -> bool:
    """Whether some calibration error explains as much as a named effect."""
    return bool(_rivals(search, named)[1])


def _rivals(search: EffectSearch, named: Fit) -> tuple[list[tuple[str, Fit, Miscalibration]], list[Miscalibration]]:
    """What can be miscalibrated beside the best part of a named set, and what of that explains as much as the set."""
    free = _with_free_reading(search, *_beside(search, named))
    return free, [error for _, fit, error in free if _explains_as_much(search, fit, named)]


def _beside(search: EffectSearch, named: Fit) -> tuple[Fit, BatchSd]:
    """The best part of a named set, beside which readings are left free, and how far its batches differ."""
    best = min(map(search.fits.__getitem__, parts_of(named.effects, search.fits)), key=lambda fit: fit.deviance)
    return best, batch_sd_of(named) if named.nuisances else ALIKE


def _explains_as_much(search: EffectSearch, fit: Fit, named: Fit) -> bool:
    return fit.deviance - named.deviance < claim_threshold(named, search.criteria)


def sufficient_calibration_error(search: EffectSearch) -> str:
    """One clause: a calibration error far beyond its prior with which the base model fits; empty if there is none."""
    base = search.fits[()]
    free = [(fit, error) for _, fit, error in _with_free_reading(search, base, ALIKE)]
    free += _with_lift_scale(search, base, ALIKE)
    enough = [error for fit, error in free if leaves_nothing(fit, search.criteria)]
    far = [error for error in enough if _in_priors(error) > FAR_OFF]
    return f"{in_words(*min(far, key=_in_priors))} would explain it all: check that first" if far else ""


@once_per_search
def _with_free_reading(search: EffectSearch, fit: Fit, batch_sd: BatchSd) -> list[tuple[str, Fit, Miscalibration]]:
    """For each zero or scale: its name, the fit with it left free, and the largest error of any of them in that fit."""
    own = nuisances_for(fit, search.criteria, batch_sd)
    places = {name: own.names.index(name) for name in READINGS if name in own.names}
    free = []
    for name, place in places.items():
        sd = own.sd.copy()
        sd[place] *= FREE
        freed = replace(own, sd=sd)
        (found,) = search.near([fit.model], fit, freed)
        errors = [(other, *found.shared[at], float(own.sd[at])) for other, at in places.items()]
        free.append((name, found, max(errors, key=_in_priors)))
    return free


def _with_lift_scale(search: EffectSearch, fit: Fit, batch_sd: BatchSd) -> list[tuple[Fit, Miscalibration]]:
    """The fit with the scale of the lift left free, and its error; none without a lift.

    Its prior is that of the scale along the track, as the cameras are calibrated alike. Its slope, the lift as
    predicted, changes with k, so the fit is repeated with that of the fit before.
    """
    if "lift" not in fit.cells.observables:
        return []
    prior = fit.cells.accuracy.speed_scale
    for _ in range(REPEATED):
        slope = np.zeros_like(fit.predicted)
        slope[:, Observable.lift] = fit.predicted[:, Observable.lift]
        own = nuisances_for(fit, search.criteria, batch_sd).and_reading(LIFT_SCALE, FREE * prior, slope)
        (fit,) = search.near([fit.model], fit, own)
    return [(fit, (LIFT_SCALE, *fit.shared[-1], prior))]


def _in_priors(error: Miscalibration) -> float:
    return abs(error[1] / error[3])
