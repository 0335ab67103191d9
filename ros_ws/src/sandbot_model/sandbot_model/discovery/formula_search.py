"""The formula to try where no set of the catalogue fits, alone or on top of effects that complement it."""

from collections.abc import Sequence

import numpy as np

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.residual import SuggestedFormula, suggest_formula
from sandbot_model.discovery.sharing import refitted_at_priors
from sandbot_model.discovery.verdict import (
    Names,
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

NEARLY_FITS = 5.0
"""Deviance per degree of freedom up to which a formula is tried with one more effect of the catalogue."""
LIBRARY_SIZE = 500
"""Approximate number of terms that a formula is selected from."""


def formula_to_try(search: EffectSearch) -> SuggestedFormula | None:
    """The best formula on top of the base model, of the best set, or of either with one more effect; None if nothing
    gains enough or pure error is unknown."""
    if np.isnan(search.fits[()].lack_of_fit_p):
        return None
    best = formula_on_top_of(search, [(), best_earned(search.fits, search.criteria).effects])
    if best is None or best.leaves_nothing:
        return best
    if best.deviance[1] > NEARLY_FITS * search.fits[best.effects].goodness.dof:
        return best
    larger = _with_one_more_effect(search, best)
    more = formula_on_top_of(search, [larger]) if larger else None
    return more if more is not None and more.bic < best.bic else best


def repairs_something(search: EffectSearch, formula: SuggestedFormula) -> bool:
    """Whether a formula leaves no lack of fit, or gains more than the best of the library would from what it leaves.

    Where cell means still scatter about a fit by c times the variance of replicates, they add c times as much to the
    gain of a term that means nothing (quasi-likelihood, see ``claim_threshold``).
    """
    left = formula.deviance[1] / search.fits[formula.effects].goodness.dof
    needed = search.criteria.claim + selection_penalty(LIBRARY_SIZE)
    return formula.leaves_nothing or formula.deviance[0] - formula.deviance[1] > needed * left


def formula_on_top_of(search: EffectSearch, sets: Sequence[Names]) -> SuggestedFormula | None:
    """The first formula on top of one of the sets that leaves no lack of fit, without nuisances or else with all of
    them; failing that, the best without. If the lift's zero is off, any formula seems to gain something."""
    wanted = list(dict.fromkeys(sets))
    search.fit("formula, on top of effects", [names for names in wanted if names not in search.fits], nearby=False)
    best = _sufficient_or_best(search, [search.fits[names] for names in wanted])
    if best is None or best.leaves_nothing:
        return best
    shared = _sufficient_or_best(search, list(refitted_at_priors(search, wanted).values()))
    return shared if shared is not None and shared.leaves_nothing else best


def _sufficient_or_best(search: EffectSearch, fits: Sequence[Fit]) -> SuggestedFormula | None:
    """The first formula on top of one of these fits, in turn, that leaves no lack of fit; else that of least BIC."""
    found = []
    for fit in fits:
        if (formula := _on_top_of(search, fit)) is not None:
            if formula.leaves_nothing:
                return formula
            found.append(formula)
    return min(found, key=lambda formula: formula.bic, default=None)


def outdone_by_a_formula(
    search: EffectSearch, claim: Verdict, fits: Sets, *, elsewhere: bool = False
) -> tuple[Verdict, SuggestedFormula] | None:
    """The verdict ``unexplained``, and the formula, if one on top of fewer effects leaves no lack of fit and its BIC is
    clearly better than the claim's, even after the price of its selection from many; else None.

    Several effects together, one under another convention or one with batch offsets can imitate a mechanism that is
    none of them. ``fits`` are those that the claim rests on: the formula gets the same nuisances. With ``elsewhere``
    only formulas on another stage of the chain count: one on the stage of a claimed effect is that effect in another
    form (``_levers_of``).
    """
    claimed = fits[claim.effects]
    own = _levers_of(claimed) if elsewhere else set()
    parts = [fit for names, fit in fits.items() if len(names) == 1 and set(names) < set(claim.effects)]
    on_top = [fits[()], *sorted(parts, key=lambda fit: fit.bic)[:1]]
    for fit in on_top:
        formula = _on_top_of(search, fit, far_above(claimed.deviance, 1.0))
        if (
            formula is not None
            and formula.leaves_nothing
            and formula.bic < claimed.bic - _lead(claimed, search.criteria)
            and formula.stage not in own
        ):
            because = (
                f"{' + '.join(claim.effects)} explains much, but one formula fits better (ΔBIC "
                f"{formula.bic - claimed.bic:.0f}): {formula.sentence}"
            )
            return Verdict("unexplained", (), (), because), formula
    return None


def _levers_of(claimed: Fit) -> set[str]:
    """The stages on which a formula may describe a claimed effect: its own, or the speed for a change of the step."""
    stages = {effect.stage for effect in claimed.model.effects}
    return stages | ({"speed"} if "step" in stages else set())


def leaves_enough_for_a_formula(claimed: Fit, criteria: Criteria) -> bool:
    """Whether a claim leaves so much more deviance than the truth would, its degrees of freedom, that a formula can be
    clearly better."""
    return claimed.deviance - claimed.goodness.dof > _lead(claimed, criteria)


def _lead(claimed: Fit, criteria: Criteria) -> float:
    """Lead in BIC from which a formula, selected from many, is clearly better than a claim."""
    return criteria.clearly * overdispersion(claimed) + selection_penalty(LIBRARY_SIZE)


def _on_top_of(search: EffectSearch, fit: Fit, hopeless: float = np.inf) -> SuggestedFormula | None:
    """The formula that gains most on top of a fit; None as in ``suggest_formula``, which depends on ``hopeless``."""
    key = _on_top_of, fit
    found: SuggestedFormula | None = search.computed.get(key) or suggest_formula(
        fit, search.effects, search.criteria, fit_all=search.fit_all, progress=search.progress, hopeless=hopeless
    )
    if found is not None:
        search.computed[key] = found
    return found


def _with_one_more_effect(search: EffectSearch, formula: SuggestedFormula) -> Names:
    """The formula's set with the effect that best complements the formula; empty if none earns its claim.

    An effect of the catalogue may show only after a stronger one outside it has been described by the formula.
    """
    effects = {**search.effects, formula.name: formula_effect(formula.formula, tried=True)}
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
