"""From the search to a verdict: the sets judged, claims tested, other conventions tried where nothing fits."""

from dataclasses import replace
from typing import Any

from sandbot_model.discovery.conventions import (
    admit_rivals,
    conventions,
    try_beside_the_leader,
    try_single_effects,
    try_within_pairs,
)
from sandbot_model.discovery.effect_search import EffectSearch, once_per_search
from sandbot_model.discovery.formula_search import leaves_enough_for_a_formula, outdone_by_a_formula
from sandbot_model.discovery.leg_radius import instead_of_effects
from sandbot_model.discovery.nuisances_about import averaged_over_scatter
from sandbot_model.discovery.one_observable import refused_from_one_observable
from sandbot_model.discovery.other_sign import refused_for_the_other_sign
from sandbot_model.discovery.partial import Partial, beyond_its_range, mostly_repaired, repairs
from sandbot_model.discovery.plausibility import effects_may_explain, robot_may_be_wrong
from sandbot_model.discovery.sharing import (
    Judged,
    has_flexible_nuisances,
    judged_with_nuisances,
    nuisances_suffice,
    refitted_as_claimed,
    refitted_globally,
)
from sandbot_model.discovery.untested import untested
from sandbot_model.discovery.verdict import EXPLAINS_ALL, Names, Verdict, either, judge, refused_as_implausible, sound
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.profile import lowest_in_profiles


def search_and_judge(search: EffectSearch, preset: Verdict | None, max_effects: int) -> tuple[Judged, Partial | None]:
    """The verdict of a search, or ``preset`` without one, and what one effect repairs if the verdict is ``partial``."""
    search.run(0 if preset else max_effects, lambda size: nuisances_suffice(search, size))
    found = Judged.of(search, preset) if preset else _judged(search)
    partial = None
    if found.verdict.status in EXPLAINS_ALL and admit_rivals(search, search.fits[found.verdict.effects]):
        found = _judged(search)
    found = _refused_for_the_other_sign(search, found) or _refused_for_a_formula(search, found) or found
    searched = not preset and len(search.fits) > 1
    if searched and (legs := _explained_by_legs(search, found)):
        return legs, None
    # One observable cannot distinguish conventions; without effects there are none.
    if found.verdict.status == "unexplained" and searched and len(search.cells.observables) > 1:
        found, partial = _under_other_conventions(search, found)
    return found, partial


def or_effects(search: EffectSearch, max_effects: int) -> str:
    """One clause: the sets that would be claimed if the doubted radius were right; empty if there are none."""
    if not effects_may_explain(search.cells) or untested(search.cells, search.model(()), search.criteria):
        return ""
    how: dict[str, Any] = {"criteria": search.criteria, "fit_all": search.fit_all, "progress": search.progress}
    as_given = EffectSearch(search.cells, search.effects, search.base, **how)
    as_given.run(max_effects, lambda size: nuisances_suffice(as_given, size))
    found = _judged(as_given).verdict
    return f"; or {either(found.alternatives)} with the radius as given" if found.status in EXPLAINS_ALL else ""


def _judged(search: EffectSearch) -> Judged:
    """The verdict on all sets fitted so far, with nuisances and with the reported standard errors."""
    search.resolve_unknown_errors()
    plain = judge(search.fits, search.criteria)
    found = judged_with_nuisances(search, plain) or Judged.of(search, plain)
    refused = refused_from_one_observable(found.verdict, found.fits)
    if refused is not None:
        return Judged.of(search, refused)
    return _by_reported_errors(search, found)


def _by_reported_errors(search: EffectSearch, found: Judged) -> Judged:
    """The verdict by the reported standard errors: where the local curvature overstates an error, an implausible value
    would pass as compatible with its plausible range."""
    if found.verdict.status not in EXPLAINS_ALL or sound(reported := reported_fit(search, found.named)[1]):
        return found
    return Judged.of(search, refused_as_implausible(reported))


@once_per_search
def reported_fit(search: EffectSearch, named: Fit) -> tuple[Fit, Fit]:
    """The deepest plausible fit of a set, and the same with its reported standard errors."""
    lower = lowest_in_profiles(refitted_globally(named))
    # Along a flat valley the lowest point may be implausible.
    named = lower if sound(lower) or not sound(named) else named
    return named, averaged_over_scatter(named, search.criteria) if named.nuisances else with_sampled_errors(named)


def _explained_by_legs(search: EffectSearch, found: Judged) -> Judged | None:
    """The refusal of a verdict where legs of another radius explain as much; else None."""
    legs = instead_of_effects(search, found) if found.verdict.status in ("unexplained", *EXPLAINS_ALL) else ""
    if not legs:
        return None
    return Judged.of(search, Verdict("unexplained", (), (), robot_may_be_wrong(legs)))


def _refused_for_a_formula(search: EffectSearch, found: Judged) -> Judged | None:
    """The refusal of a claim that a formula outdoes; None where none is clearly better, or nothing is claimed.

    Any formula speaks against several effects, an effect under another convention (picked from dozens), or a claim with
    nuisances. Against an effect of the catalogue that needs none of this, only formulas on another stage do, if it
    leaves enough for one to gain.
    """
    if found.verdict.status not in EXPLAINS_ALL:
        return None
    names = found.verdict.effects
    picked = len(names) > 1 or bool(conventions([found.fits[names]]))
    granted = picked or judge(search.fits, search.criteria).status == "unexplained"
    fits = refitted_as_claimed(search, found)
    if not granted and not leaves_enough_for_a_formula(fits[names], search.criteria):
        return None
    outdone = outdone_by_a_formula(search, found.verdict, fits, elsewhere=not granted)
    if outdone is None:
        return None
    refused, formula = outdone
    return Judged(refused, dict(search.fits), search.fits[()], formula)


def _refused_for_the_other_sign(search: EffectSearch, found: Judged) -> Judged | None:
    """The refusal of a claim, each set of which has an effect under another convention, that an effect of one sign
    equals with the other; None for others."""
    verdict = found.verdict
    if verdict.status not in EXPLAINS_ALL or not all(search.fits[names].variants for names in verdict.alternatives):
        return None
    refused = refused_for_the_other_sign(search, verdict, refitted_as_claimed(search, found))
    return None if refused is None else Judged(refused, dict(search.fits), search.fits[()])


def _under_other_conventions(search: EffectSearch, unexplained: Judged) -> tuple[Judged, Partial | None]:
    """The verdict where no set of the catalogue fits. Tried in turn: one effect under another convention, an effect
    that repairs most of the misfit, two effects of which one is under another convention."""
    usual = dict(search.fits)
    better = try_single_effects(search)
    # No claim under another convention where a catalogue formula fits clearly better, with an implausible parameter.
    most = beyond_its_range(search)
    if most and not conventions([search.fits[most[0].effects]]) and (part := _unless_a_formula(search, most)):
        return part
    if better and (found := _settled(search, usual)):
        return found, None
    adopted = search.fits
    for fits in (usual, adopted):
        search.fits = fits
        if part := _unless_a_formula(search, mostly_repaired(search)):
            return part
    for tried in (try_beside_the_leader, try_within_pairs):
        if tried(search) and (found := _settled(search, usual)):
            return found, None
    return replace(unexplained, fits=usual), None


def _settled(search: EffectSearch, usual: dict[Names, Fit]) -> Judged | None:
    """The verdict under other conventions if it may stand, or its refusal, which rests on the ``usual`` fits."""
    found = _judged(search)
    if refused := _refused_for_the_other_sign(search, found):
        return replace(refused, fits=usual)
    return found if _is_conclusive(search, found) else None


def _is_conclusive(search: EffectSearch, found: Judged) -> bool:
    """Whether a verdict under other conventions may stand. A claim may not if it also needs flexible nuisances for more
    than a small part of the misfit, or if a formula outdoes it."""
    if found.verdict.status not in EXPLAINS_ALL:
        return found.verdict.status != "unexplained"
    sets = found.verdict.alternatives
    needed = has_flexible_nuisances(found.named) and not all(
        repairs(search.fits, names, search.criteria) for names in sets
    )
    flexible = needed and conventions([search.fits[names] for names in sets])
    return not flexible and _refused_for_a_formula(search, found) is None


def _unless_a_formula(search: EffectSearch, most: tuple[Verdict, Partial] | None) -> tuple[Judged, Partial] | None:
    """The verdict that one effect repairs most of the misfit, unless a formula without it explains everything."""
    if most is None or outdone_by_a_formula(search, most[0], search.fits):
        return None
    verdict, partial = most
    return Judged.of(search, verdict), partial
