"""Effects with the other sign, such as a loss that is a gain: rivals of a claim under another convention.

An effect that can only reduce something is searched for at positive strengths only. Where the ground adds instead, one
of dozens of conventions of an effect of either sign may fit, with no rival. The catalogue's formula with the other sign
is no effect, but if it does as well, neither is to be believed.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.verdict import Names, Verdict, leaves_nothing, overdispersion
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.model import model_of


def refused_for_the_other_sign(search: EffectSearch, claim: Verdict, fits: Mapping[Names, Fit]) -> Verdict | None:
    """The refusal of a claim if an effect of one sign does as well with the other; else None. ``fits`` are those that
    the claim rests on: the rival gets the same nuisances."""
    claimed = fits[claim.effects]
    most = claimed.bic + search.criteria.clearly * overdispersion(claimed)
    as_good = [fit for fit in _reversed(search, fits[()]) if fit.bic <= most and leaves_nothing(fit, search.criteria)]
    if not as_good:
        return None
    best = min(as_good, key=lambda fit: fit.bic)
    (name,) = best.effects
    strength = next(key for key in best.parameters if key.startswith(f"{name}."))
    because = (
        f"{' + '.join(claim.effects)} would explain these data, but only under another convention; "
        f"{strength} = {best.parameters[strength].value:.3g}, of a sign that {name} can't have, fits as well "
        f"(ΔBIC {best.bic - claimed.bic:.0f})"
    )
    return Verdict("unexplained", (), (), because)


def _reversed(search: EffectSearch, base: Fit) -> list[Fit]:
    """The base model with each effect of one sign and one parameter, at the other sign."""
    turned = [
        _turned(search.effects[name], parameter)
        for name, parameter in search.strengths(())
        if parameter.hard_low == parameter.neutral and len(search.effects[name].parameters) == 1
    ]
    models = [
        model_of(search.base, (effect.identifier,), {**search.effects, effect.identifier: effect}, search.cells.robot)
        for effect in turned
    ]
    return [fit for fit in search.near(models, base) if np.isfinite(fit.bic)]


def _turned(effect: Effect, parameter: Parameter) -> Effect:
    """The effect with the range of its strength reflected at the neutral value."""
    neutral = float(parameter.neutral or 0.0)
    low, start = 2 * neutral - parameter.high, 2 * neutral - parameter.start
    turned = replace(parameter, low=low, high=neutral, start=start, hard_low=-np.inf, hard_high=neutral)
    return effect.with_parameters((turned,))
