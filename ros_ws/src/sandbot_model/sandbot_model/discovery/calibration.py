"""What a calibration would have to be for a verdict to fall: a zero or a scale that explains as much as an effect."""

from collections.abc import Iterator
from dataclasses import replace

from sandbot_model.discovery.batch_sd import ALIKE, BatchSd, batch_sd_of
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.nuisances_about import LIFT_ZERO, SPEED_SCALE, nuisances_for
from sandbot_model.discovery.nuisances_in_words import in_words
from sandbot_model.discovery.sharing import FAR_OFF
from sandbot_model.discovery.verdict import claim_threshold, leaves_nothing, parts_of
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import solve_near

FREE = 1e3
"""Factor on a prior's standard deviation that leaves a reading free."""
READINGS = {LIFT_ZERO: "zero of the lift", SPEED_SCALE: "scale along the track"}
Miscalibration = tuple[str, float, float, float]
"""A reading's name, its error, the standard error of that, and its prior's standard deviation."""


def rival_calibration_error(search: EffectSearch, named: Fit) -> str:
    """The smallest error of a zero or a scale, in its prior's terms, that explains as much as an effect that is named.

    One clause; empty where no such reading is there to be off.
    """
    weakest = min(map(search.fits.__getitem__, parts_of(named.effects, search.fits)), key=lambda fit: fit.deviance)
    free = list(_with_free_reading(search, weakest, batch_sd_of(named) if named.nuisances else ALIKE))
    price = claim_threshold(named, search.criteria)
    enough = [off for _, fit, off in free if fit.deviance - named.deviance < price]
    if enough:
        return f"{in_words(*min(enough, key=_in_priors))} would explain as much"
    return f"no {' and no '.join(READINGS[name] for name, *_ in free)} explains as much" if free else ""


def sufficient_calibration_error(search: EffectSearch) -> str:
    """The zero or the scale with which the base model leaves nothing to explain, if it is farther off than is believed.

    One clause; empty where none is.
    """
    enough = [
        off for _, fit, off in _with_free_reading(search, search.fits[()]) if leaves_nothing(fit, search.criteria)
    ]
    far = [off for off in enough if _in_priors(off) > FAR_OFF]
    return f"{in_words(*min(far, key=_in_priors))} would leave nothing to explain: check that first" if far else ""


def _with_free_reading(
    search: EffectSearch, fit: Fit, batch_sd: BatchSd = ALIKE
) -> Iterator[tuple[str, Fit, Miscalibration]]:
    """Each reading in turn, a set fitted with that free, and the reading that is off by most then, maybe another."""
    own = nuisances_for(fit, search.criteria, batch_sd)
    places = {name: own.names.index(name) for name in READINGS if name in own.names}
    for name, place in places.items():
        sd = own.sd.copy()
        sd[place] *= FREE
        freed = replace(own, sd=sd)
        found = fitted_at(fit.model, fit.cells, solve_near((fit.model, fit.cells, (fit.warm_start,), freed)), freed)
        offs = [(one, *found.shared[at], float(own.sd[at])) for one, at in places.items()]
        yield name, found, max(offs, key=_in_priors)


def _in_priors(off: Miscalibration) -> float:
    return abs(off[1] / off[3])
