"""What a calibration would have to be for a claim to fall: a zero or a scale that explains as much as the effect."""

from dataclasses import replace

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.nuisances_about import LIFT_ZERO, SPEED_SCALE, shared_by
from sandbot_model.discovery.nuisances_in_words import in_words
from sandbot_model.discovery.verdict import claim, parts_of
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import solve_near

FREE = 1e3
"""Factor on a prior's standard deviation that leaves a reading free."""


def would_fall(search: EffectSearch, named: Fit) -> str:
    """The smallest error of a zero or a scale, in its prior's terms, that explains as much as an effect that is named.

    One clause; empty where no such reading is there to be off.
    """
    assert named.nuisances is not None
    weakest = min(map(search.fits.__getitem__, parts_of(named.effects, search.fits)), key=lambda fit: fit.deviance)
    free = [(name, _freed(search, weakest, name)) for name in (LIFT_ZERO, SPEED_SCALE) if name in named.nuisances.names]
    price = claim(named, search.criteria)
    enough = [(name, fit) for name, fit in free if fit.deviance - named.deviance < price]
    if not enough:
        return f"no {' and no '.join(READINGS[name] for name, _ in free)} explains as much" if free else ""
    off = [(name, *_value(fit, name), _prior(named, name)) for name, fit in enough]
    name, value, stderr, sd = min(off, key=lambda one: abs(one[1] / one[3]))
    return f"{in_words(name, value, stderr, sd)} would explain as much"


READINGS = {LIFT_ZERO: "zero of the lift", SPEED_SCALE: "scale along the track"}


def _freed(search: EffectSearch, fit: Fit, name: str) -> Fit:
    """A set fitted with one reading free."""
    own = shared_by(fit, search.criteria)
    sd = own.sd.copy()
    sd[own.names.index(name)] *= FREE
    freed = replace(own, sd=sd)
    return fitted_at(fit.model, fit.cells, solve_near((fit.model, fit.cells, (fit.warm_start,), freed)), freed)


def _value(fit: Fit, name: str) -> tuple[float, float]:
    assert fit.nuisances is not None
    return fit.shared[fit.nuisances.names.index(name)]


def _prior(fit: Fit, name: str) -> float:
    assert fit.nuisances is not None
    return float(fit.nuisances.sd[fit.nuisances.names.index(name)])
