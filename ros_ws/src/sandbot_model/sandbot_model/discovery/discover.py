"""From trials to a verdict: is the base model adequate, and if not, which effects of the catalogue repair it?

1. Name nothing if robot.yaml or the table is in doubt (``plausibility``), or pure error is unknown (``untested``).
2. Fit the base model, then sets of one, two and three effects, until one size suffices (``effect_search``).
3. Judge the sets against the replicates (``verdict``), and again with nuisances that trials share (``sharing``).
4. Test a claim against effects under other conventions (``conventions``) and against formulas (``formula_search``).
5. If nothing fits, try effects under other conventions, and effects that repair most of the misfit (``partial``).
6. If something remains unexplained, leave out unreplicated outliers and repeat the search (``lone_trials``).
7. Report the named set with standard errors, limits and next trials.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery import one_value, repeats
from sandbot_model.discovery.candidates import candidates
from sandbot_model.discovery.conventions import conventions, other_families, same_family
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.formula_search import formula_on_top_of, formula_to_try, repairs_something
from sandbot_model.discovery.judgement import or_effects, reported_fit, search_and_judge
from sandbot_model.discovery.leg_radius import instead_of_a_reading
from sandbot_model.discovery.limits import limits
from sandbot_model.discovery.lone_trials import repeat_request, suspect_trials
from sandbot_model.discovery.next_trials import NextTrial, Proposed, next_trials, trials_to_exclude
from sandbot_model.discovery.nuisances_about import averaged_with
from sandbot_model.discovery.nuisances_in_words import significant
from sandbot_model.discovery.partial import Partial
from sandbot_model.discovery.plausibility import in_doubt
from sandbot_model.discovery.remarks import controls_of, remarked, told_from_others, worthwhile
from sandbot_model.discovery.residual import SuggestedFormula
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.sharing import Judged, allowed_for
from sandbot_model.discovery.stability import win_shares
from sandbot_model.discovery.unseen import equally_simple, largest_shift, unseen, without_nuisances
from sandbot_model.discovery.untested import to_run, untested
from sandbot_model.discovery.verdict import (
    EXPLAINS_ALL,
    INCOMPLETE,
    Sets,
    Verdict,
    judge,
    leaves_nothing,
    look_alikes,
    sound,
    with_p_of,
)
from sandbot_model.fitting.diagnose import stage_tests
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.physics.effect import Effect

LEADING = 8
"""Number of sets compared in the bootstrap, the best by BIC."""


def discover(
    cells: Cells,
    effects: Mapping[str, Effect],
    *,
    base: str = "simple",
    max_effects: int = 3,
    criteria: Criteria = DEFAULT,
    fit_all: Map = map,
    progress: Progress = lambda _stage, _done, _total: None,
    with_limits: bool = True,
) -> Discovery:
    """Search the catalogue.

    ``criteria`` are the thresholds of the verdict, ``fit_all`` maps the fits (see ``parallel``) and ``progress`` is
    called with (stage, done, total). It takes a fifth to a third less time without limits on absent effects, on which
    no verdict depends. No effect is named where robot.yaml or the table is in doubt (``plausibility``).
    Where nothing explains all trials, unreplicated outliers are left out if that explains the others (``lone_trials``).
    """

    def discovered(of: Cells) -> Discovery:
        search = EffectSearch(of, effects, base, criteria=criteria, fit_all=fit_all, progress=progress)
        return _discovered(search, max_effects, with_limits=with_limits)

    found = discovered(cells)
    if found.verdict.status not in INCOMPLETE or not len(wrong := suspect_trials(found.fits[0], criteria)):
        return found
    others = discovered(cells.without(wrong))
    if others.verdict.status in INCOMPLETE:
        return found
    verdict = others.verdict.with_remarks(repeat_request(cells, wrong))
    return replace(others, verdict=verdict, next_trials=(*repeats.alone(cells, wrong), *others.next_trials))


def _discovered(search: EffectSearch, max_effects: int, *, with_limits: bool) -> Discovery:
    if doubted := in_doubt(search.cells):
        preset: Verdict | None = Verdict("unexplained", (), (), doubted + or_effects(search, max_effects))
    else:
        preset = untested(search.cells, search.model(()), search.criteria)
    found, partial = search_and_judge(search, preset, max_effects)
    return _reported(search, found, partial, doubted=bool(doubted), with_limits=with_limits)


def _reported(
    search: EffectSearch, found: Judged, partial: Partial | None, *, doubted: bool, with_limits: bool
) -> Discovery:
    """All that is said of a verdict: standard errors, limits, next trials, remarks."""
    cells, effects, criteria, verdict = search.cells, search.effects, search.criteria, found.verdict
    rival, allowing = _identified_without_nuisances(search, found), _only_allowing(search, found)
    claimed = search.fits[verdict.effects]
    search = search.judged(found.fits, found.named.model.catalogue)
    judged = search.fits[verdict.effects]
    named, reported = reported_fit(search, found.named)
    rivals, covered = _instead(search, verdict, named, rival)
    hidden = unseen(search, named) if verdict.status == "adequate" else []
    not_shown = tuple(fit.effects[0] for fit in hidden)
    known = {fit.effects for fit in rivals}
    rivals += [fit for fit in equally_simple(reported, hidden) if fit.effects not in known]
    shift = largest_shift(reported, hidden)
    shifted = shift.in_words(reported, covered=any(fit.effects == (shift.effect,) for fit in rivals)) if shift else ""
    family = same_family(search, claimed, named)
    others = other_families(search, claimed, judged) if verdict.status == "identified" else []
    proposed = _next_trials(search, verdict, without_nuisances(search, hidden), named)
    limited = with_limits and verdict.status in ("adequate", "identified")
    controls = {} if worthwhile(proposed.trials, criteria) else controls_of(search, verdict)
    verdict = with_p_of(reported, verdict, judged)
    verdict = told_from_others(search, replace(verdict, because=verdict.because + covered), others, family)
    verdict = remarked(search, verdict, named, not_shown, proposed, controls).with_remarks(shifted)
    return Discovery(
        model=search.base,
        cells=cells,
        noise_floor=noise_floor(cells),
        # Lower steps do not fit, so the precision of their parameters is meaningless and is not sampled.
        steps=(*search.ladder(verdict)[:-1], averaged_with(reported, [*rivals, *family])),
        candidates=tuple(candidates(search.fits, effects)),
        verdict=verdict,
        next_trials=tuple(proposed.trials),
        alike=tuple(look_alikes(search.fits, judged, others, criteria)),
        allowing=allowing,
        controls=controls,
        unseen=not_shown,
        unseen_shift=shift,
        stability=_stability(search.fits, others, verdict, criteria),
        stages=stage_tests(search.fits[()]),
        # This fits further sets, which are no candidates.
        residual=None if doubted else _residual_formula(search, verdict, found.formula),
        partial=partial,
        variants=conventions([search.fits[names] for names in verdict.alternatives]),
        limits=tuple(limits(search, named, not_shown)) if limited else (),
        fits=tuple(sorted(search.fits.values(), key=lambda fit: fit.bic)),
        criteria=criteria,
    )


def _instead(search: EffectSearch, verdict: Verdict, named: Fit, rival: Fit | None) -> tuple[list[Fit], str]:
    """Fits that explain as much in another way, so that standard errors must cover them, and what is said of them: the
    ``rival``, and legs of another radius."""
    legs = instead_of_a_reading(search, named) if verdict.status in ("adequate", *EXPLAINS_ALL) else None
    fits = [*([rival] if rival else []), *([legs.fit] if legs else [])]
    if not fits:
        return [], ""
    size = f"; {legs.in_words(search.cells.robot)} explain as much: measure them" if legs else ""
    return fits, f"{size} (standard errors of Δt and k cover {'both' if len(fits) == 1 else 'all three'})"


def _identified_without_nuisances(search: EffectSearch, found: Judged) -> Fit | None:
    """What would be identified without the zero, scale or drift with which the base model is adequate; None if nothing
    would."""
    if found.verdict.status != "adequate" or not significant(found.named):
        return None
    plain = judge(search.fits, search.criteria)
    return search.fits[plain.effects] if plain.status == "identified" else None


def _only_allowing(search: EffectSearch, found: Judged) -> str:
    """The nuisances, in words, without which an adequate base model would show lack of fit; else empty."""
    if found.verdict.status != "adequate" or leaves_nothing(search.fits[()], search.criteria):
        return ""
    return " and ".join(allowed_for(found.named, search.criteria))


def _next_trials(search: EffectSearch, verdict: Verdict, hidden: Sequence[Fit], named: Fit) -> Proposed:
    """The trials to run next: what the verdict asks for again, then those that would show ``hidden`` effects, or tell
    its sets apart."""
    base, alternatives = search.fits[()], [search.fits[names] for names in verdict.alternatives]
    if verdict.status == "untested":
        return Proposed(to_run(search.cells, search.model(())))
    found = trials_to_exclude(base, hidden) if hidden else Proposed(next_trials(alternatives, search.criteria))
    more = one_value.what_to_add(base) if verdict.status in one_value.WIDENED else []
    again = repeats.decisive(search.fits, verdict, search.criteria)
    again += repeats.again(repeats.odd_one_out(verdict, named), named)
    # Between explanations that are still possible, what decides comes first.
    asked = [*found.trials, *again] if verdict.status == "ambiguous" else [*again, *found.trials]
    first: dict[object, NextTrial] = {}
    for trial in [*asked, *more]:
        first.setdefault((trial.condition, trial.gait), trial)
    return found._replace(trials=list(first.values()))


def _residual_formula(
    search: EffectSearch, verdict: Verdict, refused_for: SuggestedFormula | None
) -> SuggestedFormula | None:
    """A formula for the remaining misfit, where no set explains all: the one that a claim was ``refused_for``."""
    if verdict.status not in INCOMPLETE or refused_for is not None:
        return refused_for
    partial = verdict.status == "partial"
    found = formula_on_top_of(search, [verdict.effects]) if partial else formula_to_try(search)
    return found if found is not None and repairs_something(search, found) else None


def _stability(fits: Sets, others: Sequence[Fit], verdict: Verdict, criteria: Criteria) -> float:
    # What is partial leads the single effects only: larger sets may fit better, and are not to be believed.
    if verdict.status in ("untested", *INCOMPLETE):
        return float("nan")
    named = verdict.alternatives or ((),)
    leading = sorted((fit for fit in (*fits.values(), *others) if sound(fit)), key=lambda fit: fit.bic)[:LEADING]
    leading += [fits[names] for names in named if fits[names] not in leading]
    shares = win_shares(leading, np.random.default_rng(0), criteria)
    return sum(share for fit, share in zip(leading, shares, strict=True) if fit.effects in named)
