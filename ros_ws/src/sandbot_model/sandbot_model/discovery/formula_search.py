"""Nothing of the catalogue fits: the formula to try, by itself or on top of the effects that go with it."""

from collections.abc import Sequence

import numpy as np

from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.residual import SuggestedFormula, suggest_formula
from sandbot_model.discovery.sharing import refitted_at_priors
from sandbot_model.discovery.verdict import (
    Sets,
    Verdict,
    best_earned,
    claim_threshold,
    overdispersion,
    selection_penalty,
    sound,
)
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import far_above, solve
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of

NEARLY = 5.0
"""Deviance per degree of freedom up to which a formula may lack just one effect of the catalogue beside it."""
TERMS = 500
"""Terms that a formula is picked from, about."""


def formula_to_try(search: EffectSearch) -> SuggestedFormula | None:
    """On top of nothing if that is enough, or of the best set, or of one effect more; None where nothing says what is
    noise."""
    if np.isnan(search.fits[()].lack_of_fit_p):
        return None
    best = formula_on_top_of(search, [(), best_earned(search.fits, search.criteria).effects])
    if best is None or best.leaves_nothing:
        return best
    if best.deviance[1] > NEARLY * search.fits[best.effects].goodness.dof:
        return best
    beside = _beside(search, best)
    more = formula_on_top_of(search, [beside]) if beside else None
    return more if more is not None and more.bic < best.bic else best


def formula_on_top_of(search: EffectSearch, sets: Sequence[Names]) -> SuggestedFormula | None:
    """The formula that repairs most of what sets miss: the first that leaves replicates nothing to explain, by itself
    or beside all that trials may share, or the best by itself. In a lift that is read too high any formula repairs
    something."""
    wanted = list(dict.fromkeys(sets))
    search.fit("formula, beside an effect", [names for names in wanted if names not in search.fits], nearby=False)
    best = _enough_or_best(search, [search.fits[names] for names in wanted])
    if best is None or best.leaves_nothing:
        return best
    shared = _enough_or_best(search, list(refitted_at_priors(search, wanted).values()))
    return shared if shared is not None and shared.leaves_nothing else best


def _enough_or_best(search: EffectSearch, fits: Sequence[Fit]) -> SuggestedFormula | None:
    """The first formula that leaves replicates nothing to explain, on top of these in turn, or the best."""
    found = []
    for fit in fits:
        if (formula := _on_top_of(search, fit)) is not None:
            if formula.leaves_nothing:
                return formula
            found.append(formula)
    return min(found, key=lambda formula: formula.bic, default=None)


def outdone_by_a_formula(search: EffectSearch, claim: Verdict, fits: Sets) -> Verdict | None:
    """Unexplained, where one formula on fewer effects, picked from many, leaves replicates nothing to explain and fits
    clearly better than what is claimed.

    Several effects together, or one in another shape or beside a bed that scatters, can imitate what none of them is.
    ``fits`` are those that the claim rests on: what these take for granted the formula has, too.
    """
    claimed = fits[claim.effects]
    parts = [fit for names, fit in fits.items() if len(names) == 1 and set(names) < set(claim.effects)]
    on_top = [fits[()], *sorted(parts, key=lambda fit: fit.bic)[:1]]
    lead = search.criteria.clearly * overdispersion(claimed) + selection_penalty(TERMS)
    for fit in on_top:
        formula = _on_top_of(search, fit, far_above(claimed.deviance, 1.0))
        if formula is not None and formula.bic < claimed.bic - lead and formula.leaves_nothing:
            because = (
                f"{' + '.join(claim.effects)} explains much, but one formula fits better (ΔBIC "
                f"{formula.bic - claimed.bic:.0f}): {formula.sentence}"
            )
            return Verdict("unexplained", (), (), because)
    return None


def _on_top_of(search: EffectSearch, fit: Fit, hopeless: float = np.inf) -> SuggestedFormula | None:
    """The formula that repairs most of what a fit misses; None where its first look stays above a deviance."""
    if fit not in search.formulas:
        found = suggest_formula(
            fit,
            search.effects,
            search.criteria,
            fit_all=search.fit_all,
            progress=search.progress,
            hopeless=hopeless,
        )
        if found is None:
            return None
        search.formulas[fit] = found
    return search.formulas[fit]


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
        if sound(fit) and alone.deviance - fit.deviance > claim_threshold(fit, search.criteria)
    ]
    return min(helpful, default=(0.0, ()))[1]
