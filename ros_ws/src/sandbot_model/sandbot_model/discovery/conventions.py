"""Other conventions of effects' formulas (``physics.variants``): where no set fits, and where several effects do."""

from collections.abc import Sequence
from itertools import product

from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.verdict import overdispersion, parts_of, passes, sound
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import WarmStart, solve
from sandbot_model.physics.model import Model, model_of
from sandbot_model.physics.variants import variants_of

PAIRS = 3
"""Pairs that are tried under other conventions, the best; of single effects all are."""


def other_conventions(search: EffectSearch) -> bool:
    """Give single effects and the best pairs the convention that fits them best; whether any fits clearly better.

    Each is looked at near the best smaller set, the best of all then anywhere.
    """
    better = [names for names in _leading(search) if _better(search, names)]
    if better:
        best = min(better, key=lambda names: search.fits[names].bic)
        fit = search.fits[best]
        anywhere = _fitted(search, [fit.model], fit.warm_start, nearby=False)[0]
        search.fits[best] = anywhere if anywhere.deviance < fit.deviance else fit
    return bool(better)


def one_in_place_of(search: EffectSearch, several: Fit) -> bool:
    """Give single effects a convention under which they leave nothing to explain, where that is clearly better than
    ``several`` effects under the usual ones; whether any is.
    """
    limit = several.bic - search.criteria.clearly * overdispersion(several)
    names = [(name,) for name in search.names if not passes(search.fits[name,], search.criteria)]
    models = [model for one in names for model in _models(search, one)]
    found = _fitted(search, models, search.fits[()].warm_start, nearby=True)
    good = [fit for fit in found if fit.bic < limit and passes(fit, search.criteria)]
    search.fits |= {fit.effects: fit for fit in sorted(good, key=lambda fit: -fit.bic)}
    return bool(good)


def _better(search: EffectSearch, names: Names) -> bool:
    """Whether a set fits clearly better under another convention, which then takes its place."""
    models = _models(search, names)
    start = min((search.fits[part] for part in parts_of(names, search.fits)), key=lambda fit: fit.deviance).warm_start
    found = [fit for fit in _fitted(search, models, start, nearby=True) if sound(fit)]
    best = min(found, key=lambda fit: fit.deviance, default=search.fits[names])
    if best.deviance >= search.fits[names].deviance - search.criteria.clearly:
        return False
    search.fits[names] = best
    return True


def _fitted(search: EffectSearch, models: Sequence[Model], start: WarmStart, *, nearby: bool) -> list[Fit]:
    points = search.fit_all(solve, [(model, search.cells, start, nearby) for model in models])
    return [fitted_at(model, search.cells, point) for model, point in zip(models, points, strict=True)]


def conventions(fit: Fit) -> dict[str, str]:
    """The other convention that each effect of a fit follows, if it does."""
    return {effect.identifier: effect.variant for effect in fit.model.effects if effect.variant}


def _leading(search: EffectSearch) -> list[Names]:
    best = sorted(search.fits, key=lambda names: search.fits[names].bic)
    found: list[Names] = []
    for size, most in ((1, len(best)), (2, PAIRS)):
        found += [names for names in best if len(names) == size][:most]
    return found


def _models(search: EffectSearch, names: Names) -> list[Model]:
    """A set under all conventions but those it was fitted with."""
    own = [(search.effects[name], *variants_of(search.effects[name])) for name in names]
    swaps = [{effect.identifier: effect for effect in some} for some in list(product(*own))[1:]]
    return [model_of(search.base, names, {**search.effects, **swapped}, search.cells.robot) for swapped in swaps]
