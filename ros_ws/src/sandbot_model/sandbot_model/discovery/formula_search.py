"""Nothing of the catalogue fits: the formula to try, by itself or on top of the effects that go with it."""

import numpy as np

from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.residual import SuggestedFormula, suggest_formula
from sandbot_model.discovery.verdict import best_earned, claim, sound
from sandbot_model.fitting.fit import fitted_at
from sandbot_model.fitting.global_minimum import solve
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of

NEARLY = 5.0
"""Deviance per degree of freedom up to which a formula may lack just one effect of the catalogue beside it."""


def formula_to_try(search: EffectSearch) -> SuggestedFormula | None:
    """On top of nothing if that is enough, or of the best set; None where nothing says what is noise."""
    if np.isnan(search.fits[()].lack_of_fit_p):
        return None
    found = []
    for effects in dict.fromkeys(((), best_earned(search.fits, search.criteria).effects)):
        if (formula := formula_on_top_of(search, effects)) is not None:
            if formula.passes(search.criteria):
                return formula
            found.append(formula)
    if not found:
        return None
    best = min(found, key=lambda formula: formula.bic)
    if best.deviance[1] > NEARLY * search.fits[best.effects].goodness.dof:
        return best
    beside = _beside(search, best)
    more = formula_on_top_of(search, beside) if beside else None
    return more if more is not None and more.bic < best.bic else best


def formula_on_top_of(search: EffectSearch, effects: Names) -> SuggestedFormula | None:
    """The formula that repairs most of what a set misses."""
    if effects not in search.fits:
        search.fit("formula, beside an effect", [effects], nearby=False)
    return suggest_formula(
        search.fits[effects], search.effects, search.criteria, fit_all=search.fit_all, progress=search.progress
    )


def _beside(search: EffectSearch, formula: SuggestedFormula) -> Names:
    """The formula's set with the one effect more that suits it best; empty if none is worth adding.

    An effect of the catalogue beside a strong one of another kind may not be seen before that is described.
    """
    effects = {**search.effects, formula.name: formula_effect(formula.formula)}
    sets = search.extended(formula.effects)
    first, *others = [
        model_of(search.base, (*names, formula.name), effects, search.cells.robot) for names in (formula.effects, *sets)
    ]
    start = search.fits[formula.effects].warm_start
    alone = fitted_at(first, search.cells, solve((first, search.cells, start)))
    helpful = [
        (fit.bic, names)
        for names, fit in zip(sets, search.near(others, alone), strict=True)
        if sound(fit) and alone.deviance - fit.deviance > claim(fit, search.criteria)
    ]
    return min(helpful, default=(0.0, ()))[1]
