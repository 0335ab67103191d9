"""From trials to a verdict: is the base model adequate, and if not, which effects of the catalogue repair it?

1. Name nothing if robot.yaml or the table is in doubt (``plausibility``), or pure error is unknown (``untested``).
2. Fit the base model, then sets of one, two and three effects, until one size suffices (``effect_search``).
3. Judge the sets against the replicates (``verdict``), and again with nuisances that trials share (``sharing``).
4. Test a claim against effects under other conventions (``conventions``) and against formulas (``formula_search``).
5. If nothing fits, try effects under other conventions, and effects that repair most of the misfit (``partial``).
6. If something remains unexplained, leave out unreplicated outliers and repeat the search (``lone_trials``).
7. Report the named set with standard errors, limits and next trials.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import chain
from typing import Any

import numpy as np

from sandbot_common.robot import to_mapping
from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery import one_value
from sandbot_model.discovery.calibration_error import rival_calibration_error, sufficient_calibration_error
from sandbot_model.discovery.candidates import Candidate, candidates, nearly_claimed, only_implausible
from sandbot_model.discovery.conventions import (
    admit_rivals,
    conventions,
    other_families,
    same_family,
    try_beside_the_leader,
    try_single_effects,
    try_within_pairs,
)
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.formula_search import (
    formula_on_top_of,
    formula_to_try,
    leaves_enough_for_a_formula,
    outdone_by_a_formula,
    repairs_something,
)
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.discovery.leg_radius import instead_of_a_reading, instead_of_effects
from sandbot_model.discovery.limits import Limit, limits
from sandbot_model.discovery.lone_trials import repeat_request, suspect_trials
from sandbot_model.discovery.next_trials import NextTrial, next_trials, trials_to_exclude
from sandbot_model.discovery.nuisances_about import averaged_over_scatter, averaged_with
from sandbot_model.discovery.nuisances_in_words import confounded_drift, significant
from sandbot_model.discovery.one_observable import refused_from_one_observable
from sandbot_model.discovery.other_sign import refused_for_the_other_sign
from sandbot_model.discovery.partial import Partial, beyond_its_range, mostly_repaired, repairs
from sandbot_model.discovery.plausibility import effects_may_explain, implausible_k, in_doubt, robot_may_be_wrong
from sandbot_model.discovery.residual import SuggestedFormula
from sandbot_model.discovery.sharing import (
    Shared,
    allowed_for,
    has_flexible_nuisances,
    judged_with_nuisances,
    nuisances_suffice,
    refitted_as_claimed,
    refitted_globally,
)
from sandbot_model.discovery.stability import win_shares
from sandbot_model.discovery.unseen import Shift, equally_simple, largest_shift, unseen, without_nuisances
from sandbot_model.discovery.untested import plainly_missed, to_run, untested
from sandbot_model.discovery.verdict import (
    EXPLAINS_ALL,
    Sets,
    Verdict,
    either,
    in_full,
    judge,
    leaves_nothing,
    look_alikes,
    next_best,
    p_in_words,
    refused_as_implausible,
    sound,
)
from sandbot_model.fitting.diagnose import StageTest, stage_tests
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.fitting.plain import data_summary, number, plain
from sandbot_model.fitting.profile import lowest_in_profiles
from sandbot_model.fitting.text import WIDTH, html_table, table
from sandbot_model.physics.effect import Effect

SCHEMA = "sandbot.discovery/2"
LEADING = 8
"""Number of sets compared in the bootstrap, the best by BIC."""
INCOMPLETE = ("partial", "unexplained")
"""Verdicts that leave part of the data unexplained."""
WIDENED = ("adequate", "ambiguous")
"""Verdicts after which trials at other ω or φ are proposed if all are at one (see ``one_value``)."""


@dataclass(frozen=True, eq=False, repr=False)
class Discovery:
    """Everything ``discover`` found. ``steps`` is the ladder: the base model, then one more effect at each step."""

    model: str
    cells: Cells
    noise_floor_m_s: float
    noise_floor: Mapping[str, float]
    steps: tuple[Fit, ...]
    candidates: tuple[Candidate, ...]
    verdict: Verdict
    next_trials: tuple[NextTrial, ...]
    stability: float = float("nan")
    """Share of bootstrap draws in which the named set, or one of its alternatives, is best among the leading sets; NaN
    where the verdict does not name what is best of all sets."""
    unseen: tuple[str, ...] = ()
    """If the base model is adequate: effects that these data would not reveal at their usual strength."""
    unseen_shift: Shift | None = None
    """The largest shift of Δt that one of these would cause, if it exceeds two of its errors."""
    stages: tuple[StageTest, ...] = ()
    """Tests of each stage of the chain: where the base model fails."""
    residual: SuggestedFormula | None = None
    """If no set of the catalogue fits: a formula to try for the remaining misfit."""
    fits: tuple[Fit, ...] = ()
    """Every set that was fitted, in order of BIC."""
    partial: Partial | None = None
    """If one effect repairs most of the misfit: what share of it, where it holds and where it fails."""
    variants: Mapping[str, str] = field(default_factory=dict)
    """The convention of each named effect whose formula departs from the catalogue's."""
    limits: tuple[Limit, ...] = ()
    """Limits at 95 % on effects that are absent."""
    alike: tuple[Fit, ...] = ()
    """Sets with effects in another form than the catalogue's that do not fit clearly worse than the identified one."""
    allowing: str = ""
    """What the trials share, in words, without which an adequate base model would show lack of fit; else empty."""
    controls: Mapping[str, str] = field(default_factory=dict)
    """If no trial distinguishes the alternatives: the experiments by which their effects show (``Effect.control``)."""
    criteria: Criteria = DEFAULT
    """The thresholds of the verdict."""

    @property
    def fit(self) -> Fit:
        """The last step of the ladder: the set that the verdict names, or the base model."""
        return self.steps[-1]

    @property
    def only_implausible(self) -> dict[str, str]:
        """Single effects that are not named, as they leave no lack of fit only with the values given, in words."""
        found = only_implausible(self.candidates, self.fits, self.criteria)
        return {name: values for name, values in found.items() if (name,) not in self.verdict.alternatives}

    def to_dict(self) -> dict[str, Any]:
        """Plain data of schema ``sandbot.discovery/2``; unknown numbers are None."""
        return {
            "schema": SCHEMA,
            "model": self.model,
            "robot": to_mapping(self.cells.robot),
            "data": data_summary(self.cells),
            "noise_floor_m_s": number(self.noise_floor_m_s),
            "noise_floor": {name: number(value) for name, value in self.noise_floor.items()},
            "steps": [step.to_dict() for step in self.steps],
            "candidates": [plain(candidate) for candidate in self.candidates],
            "verdict": {
                "status": self.verdict.status,
                "effects": list(self.verdict.effects),
                "alternatives": [list(names) for names in self.verdict.alternatives],
                "because": self.verdict.because,
            },
            "next_trials": [plain(trial) for trial in self.next_trials],
            "controls": dict(self.controls),
            "unseen": list(self.unseen),
            "unseen_shift": None if self.unseen_shift is None else plain(self.unseen_shift),
            "stability": number(self.stability),
            "stages": [plain(stage) for stage in self.stages],
            "residual": None if self.residual is None else plain(self.residual),
            "nuisances": self.fit.nuisances_to_dict(),
            "partial": None if self.partial is None else plain(self.partial),
            "variants": dict(self.variants),
            "limits": [plain(limit) for limit in self.limits],
        }

    @property
    def headline(self) -> str:
        """The verdict in a few words: ``identified: stance_overlap``, ``ambiguous: one of 2 sets: a; b``."""
        sets = [in_full(names, self.variants) for names in self.verdict.alternatives]
        if self.verdict.status == "ambiguous":
            return f"ambiguous: one of {len(sets)} sets: {'; '.join(sets)}"
        named = " or ".join(sets)
        if self.allowing:
            return f"{self.verdict.status}, allowing for {self.allowing}"
        return f"{self.verdict.status}: {named}" if named else self.verdict.status

    @property
    def stability_in_words(self) -> str:
        """How often the named set, or one of the alternatives, is best; empty if none is named."""
        if not np.isfinite(self.stability):
            return ""
        which = "one of these is the" if self.verdict.status == "ambiguous" else ""
        return f"{which} best in {100 * self.stability:.0f} % of bootstrap draws".strip()

    def in_words(self, effect: str) -> str:
        """An effect, with its convention if that is not the catalogue's."""
        return f"{effect} ({self.variants[effect]})" if effect in self.variants else effect

    def __repr__(self) -> str:
        best = f" ({self.stability_in_words})" if self.stability_in_words else ""
        lines = [
            f"{self.headline}{best}",
            textwrap.fill(self.verdict.because, WIDTH),
            "",
            table(ladder_rows(self.steps)),
            "",
            repr(self.fit),
        ]
        if self.residual is not None:
            lines += ["", f"try: {self.residual.formula}"]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head, because = escape(self.headline), escape(self.verdict.because)
        tables = html_table(ladder_rows(self.steps)) + self.fit._repr_html_()
        return f"<p><b>{head}</b><br>{because}</p>{tables}"


def discover(
    cells: Cells,
    effects: Mapping[str, Effect],
    *,
    base: str = "simple",
    max_effects: int = 3,
    criteria: Criteria = DEFAULT,
    fit_all: Map = map,
    progress: Progress = lambda _stage, _done, _total: None,
) -> Discovery:
    """Search the catalogue.

    ``criteria`` are the thresholds of the verdict, ``fit_all`` maps the fits (see ``parallel``) and ``progress`` is
    called with (stage, done, total). No effect is named where robot.yaml or the table is in doubt (``plausibility``).
    Where nothing explains all trials, unreplicated outliers are left out if that explains the others (``lone_trials``).
    """
    how: dict[str, Any] = {"base": base, "criteria": criteria, "fit_all": fit_all, "progress": progress}
    found = _discovered(cells, effects, max_effects, **how)
    if found.verdict.status not in INCOMPLETE or not len(wrong := suspect_trials(found.fits[0], criteria)):
        return found
    others = _discovered(cells.without(wrong), effects, max_effects, **how)
    if others.verdict.status in INCOMPLETE:
        return found
    return replace(others, verdict=others.verdict.with_remarks(repeat_request(cells, wrong)))


def _discovered(
    cells: Cells,
    effects: Mapping[str, Effect],
    max_effects: int,
    *,
    base: str,
    criteria: Criteria,
    fit_all: Map,
    progress: Progress,
) -> Discovery:
    search = EffectSearch(cells, effects, base, criteria=criteria, fit_all=fit_all, progress=progress)
    if doubted := in_doubt(cells):
        doubted += _or_effects(search, max_effects)
    preset = Verdict("unexplained", (), (), doubted) if doubted else untested(cells, search.model(()), criteria)
    found, partial = _search_and_judge(search, preset, max_effects)
    rival, allowing = _identified_without_nuisances(search, found), _only_allowing(search, found)
    claimed = search.fits[found.verdict.effects]
    search.fits, verdict, named = found.fits, found.verdict, found.named
    search.effects = {**effects, **named.model.catalogue}
    # Lower steps of the ladder do not fit, so the precision of their parameters is meaningless and is not sampled.
    below = search.ladder(verdict)[:-1]
    # The sentence was written about the fit without nuisances.
    told = p_in_words(search.fits[verdict.effects])
    named, reported = _reported(search, named)
    verdict = replace(verdict, because=p_in_words(reported).join(verdict.because.rsplit(told, 1)))
    rivals, covered = _instead(search, verdict, named, rival)
    verdict = replace(verdict, because=verdict.because + covered)
    floor = noise_floor(cells)
    hidden = unseen(search, named) if verdict.status == "adequate" else []
    not_shown = tuple(fit.effects[0] for fit in hidden)
    shift = largest_shift(reported, hidden)
    known = {fit.effects for fit in rivals}
    rivals += [fit for fit in equally_simple(reported, hidden) if fit.effects not in known]
    shifted = shift.in_words(reported, covered=any(fit.effects == (shift.effect,) for fit in rivals)) if shift else ""
    family = same_family(search, claimed, named)
    reported = averaged_with(reported, [*rivals, *family])
    trials, out_of_reach = _next_trials(search, verdict, without_nuisances(search, hidden))
    controls = {} if _telling(trials, criteria) else _controls(search, verdict)
    others = other_families(search, claimed, search.fits[verdict.effects]) if verdict.status == "identified" else []
    verdict = _told_from_others(search, verdict, others, family)
    verdict = _with_remarks(search, verdict, named, not_shown, trials, out_of_reach, controls).with_remarks(shifted)
    return Discovery(
        model=base,
        cells=cells,
        noise_floor_m_s=floor["speed"],
        noise_floor=floor,
        steps=(*below, reported),
        candidates=tuple(candidates(search.fits, effects)),
        verdict=verdict,
        next_trials=tuple(trials),
        alike=tuple(look_alikes(search.fits, search.fits[verdict.effects], others, criteria)),
        allowing=allowing,
        controls=controls,
        unseen=not_shown,
        unseen_shift=shift,
        stability=_stability(search.fits, others, verdict, criteria),
        stages=stage_tests(search.fits[()]),
        residual=_residual_formula(search, verdict, found.formula) if not doubted else None,
        partial=partial,
        variants=conventions([search.fits[names] for names in verdict.alternatives]),
        limits=tuple(limits(search, named, not_shown)) if verdict.status in ("adequate", "identified") else (),
        fits=tuple(sorted(search.fits.values(), key=lambda fit: fit.bic)),
        criteria=criteria,
    )


def _or_effects(search: EffectSearch, max_effects: int) -> str:
    """One clause: the sets that would be claimed if the doubted radius were right; empty if there are none."""
    if not effects_may_explain(search.cells) or untested(search.cells, search.model(()), search.criteria):
        return ""
    how: dict[str, Any] = {"criteria": search.criteria, "fit_all": search.fit_all, "progress": search.progress}
    as_given = EffectSearch(search.cells, search.effects, search.base, **how)
    as_given.run(max_effects, lambda size: nuisances_suffice(as_given, size))
    found = _judged(as_given).verdict
    return f"; or {either(found.alternatives)} with the radius as given" if found.status in EXPLAINS_ALL else ""


def _instead(search: EffectSearch, verdict: Verdict, named: Fit, rival: Fit | None) -> tuple[list[Fit], str]:
    """Fits that explain as much in another way, so that standard errors must cover them, and what is said of them: the
    ``rival``, and legs of another radius."""
    legs = instead_of_a_reading(search, named) if verdict.status in ("adequate", *EXPLAINS_ALL) else None
    fits = [*([rival] if rival else []), *([legs.fit] if legs else [])]
    if not fits:
        return [], ""
    size = f"; {legs.in_words(search.cells.robot)} explain as much: measure them" if legs else ""
    return fits, f"{size} (standard errors of Δt and k cover {'both' if len(fits) == 1 else 'all three'})"


def _identified_without_nuisances(search: EffectSearch, found: Shared) -> Fit | None:
    """What would be identified without the zero, scale or drift with which the base model is adequate; None if nothing
    would."""
    if found.verdict.status != "adequate" or not significant(found.named):
        return None
    plain = judge(search.fits, search.criteria)
    return search.fits[plain.effects] if plain.status == "identified" else None


def _only_allowing(search: EffectSearch, found: Shared) -> str:
    """The nuisances, in words, without which an adequate base model would show lack of fit; else empty."""
    if found.verdict.status != "adequate" or leaves_nothing(search.fits[()], search.criteria):
        return ""
    return " and ".join(allowed_for(found.named, search.criteria))


def _search_and_judge(search: EffectSearch, preset: Verdict | None, max_effects: int) -> tuple[Shared, Partial | None]:
    """The verdict of a search, or ``preset`` without one, and what one effect repairs if the verdict is ``partial``."""
    search.run(0 if preset else max_effects, lambda size: nuisances_suffice(search, size))
    found = Shared(preset, search.fits, search.fits[()]) if preset else _judged(search)
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


def _explained_by_legs(search: EffectSearch, found: Shared) -> Shared | None:
    """The refusal of a verdict where legs of another radius explain as much; else None."""
    legs = instead_of_effects(search, found) if found.verdict.status in ("unexplained", *EXPLAINS_ALL) else ""
    if not legs:
        return None
    return Shared(Verdict("unexplained", (), (), robot_may_be_wrong(legs)), search.fits, search.fits[()])


def _by_reported_errors(search: EffectSearch, found: Shared) -> Shared:
    """The verdict by the reported standard errors: where the local curvature overstates an error, an implausible value
    would pass as compatible with its plausible range."""
    if found.verdict.status not in EXPLAINS_ALL or sound(reported := _reported(search, found.named)[1]):
        return found
    return Shared(refused_as_implausible(reported), search.fits, search.fits[()])


def _reported(search: EffectSearch, named: Fit) -> tuple[Fit, Fit]:
    """The deepest plausible fit of a set, and the same with its reported standard errors."""
    if named not in search.reported:
        search.reported[named] = _with_errors(named, search.criteria)
    return search.reported[named]


def _with_errors(named: Fit, criteria: Criteria) -> tuple[Fit, Fit]:
    lower = lowest_in_profiles(refitted_globally(named))
    # Along a flat valley the lowest point may be implausible.
    named = lower if sound(lower) or not sound(named) else named
    return named, averaged_over_scatter(named, criteria) if named.nuisances else with_sampled_errors(named)


def _told_from_others(search: EffectSearch, verdict: Verdict, others: Sequence[Fit], family: Sequence[Fit]) -> Verdict:
    """The verdict with what comes next, ``others`` under other conventions included, and what its errors cover."""
    because = [verdict.because]
    if verdict.status == "identified":
        because.append(next_best(search.fits, search.fits[verdict.effects], others, search.criteria))
    if family:
        because.append("standard errors cover its conventions that explain as much")
    return replace(verdict, because="; ".join(filter(None, because)))


def _next_trials(search: EffectSearch, verdict: Verdict, hidden: Sequence[Fit]) -> tuple[list[NextTrial], list[str]]:
    """The trials to run next, and those of the ``hidden`` effects that none within reach would show."""
    if verdict.status == "untested":
        return to_run(search.cells, search.model(())), []
    base, alternatives = search.fits[()], [search.fits[names] for names in verdict.alternatives]
    trials, out_of_reach = (
        trials_to_exclude(base, hidden) if hidden else (next_trials(alternatives, search.criteria), [])
    )
    return [*trials, *(one_value.what_to_add(base) if verdict.status in WIDENED else [])], out_of_reach


def _with_remarks(
    search: EffectSearch,
    verdict: Verdict,
    named: Fit,
    hidden: Sequence[str],
    trials: Sequence[NextTrial],
    out_of_reach: Sequence[str],
    controls: Mapping[str, str],
) -> Verdict:
    """The verdict with remarks: calibration errors, hidden effects, the most informative trial, look-alikes."""
    remarks = [implausible_k(search.fits[()])]
    if verdict.status == "adequate":
        remarks.append(nearly_claimed(search.fits, search.criteria))
    if hidden:
        remarks.append(_not_excluded(hidden, trials, out_of_reach, search))
    if len(verdict.alternatives) > 1:
        remarks.append(_most_discriminating(trials, controls, search.criteria))
    if verdict.status in WIDENED:
        remarks.append(one_value.in_words(search.cells))
    if verdict.status == "identified":
        remarks.append(rival_calibration_error(search, named))
    # Where the robot is in doubt this search had no effects, and calibration is not the question.
    if verdict.status == "unexplained" and len(search.fits) > 1:
        remarks.append(sufficient_calibration_error(search))
    if verdict.status in ("identified", "partial"):
        remarks += [_mistaken(effect) for effect in named.model.effects if effect.mistaken_for]
    if verdict.status == "untested":
        remarks.append(plainly_missed(search.fits[()]))
    elif len(search.fits) > 1:
        remarks.append(confounded_drift(search.cells))
    return verdict.with_remarks(*remarks)


def _mistaken(effect: Effect) -> str:
    """What no trial distinguishes from an effect, and the control experiment that does."""
    control = f"; the control of {effect.identifier} tells ({effect.control})" if effect.control else ""
    return f"{effect.mistaken_for} would look the same{control}"


def _refused_for_a_formula(search: EffectSearch, found: Shared) -> Shared | None:
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
    return Shared(refused, dict(search.fits), search.fits[()], formula)


def _refused_for_the_other_sign(search: EffectSearch, found: Shared) -> Shared | None:
    """The refusal of a claim, each set of which has an effect under another convention, that an effect of one sign
    equals with the other; None for others."""
    verdict = found.verdict
    if verdict.status not in EXPLAINS_ALL or not all(search.fits[names].variants for names in verdict.alternatives):
        return None
    refused = refused_for_the_other_sign(search, verdict, refitted_as_claimed(search, found))
    return None if refused is None else Shared(refused, dict(search.fits), search.fits[()])


def _judged(search: EffectSearch) -> Shared:
    """The verdict on all sets fitted so far, with nuisances and with the reported standard errors."""
    search.resolve_unknown_errors()
    plain = judge(search.fits, search.criteria)
    found = judged_with_nuisances(search, plain) or Shared(plain, search.fits, search.fits[plain.effects])
    refused = refused_from_one_observable(found.verdict, found.fits)
    if refused is not None:
        return Shared(refused, search.fits, search.fits[()])
    return _by_reported_errors(search, found)


def _under_other_conventions(search: EffectSearch, unexplained: Shared) -> tuple[Shared, Partial | None]:
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
    for fits in (usual, search.fits):
        search.fits = fits
        if part := _unless_a_formula(search, mostly_repaired(search)):
            return part
    for tried in (try_beside_the_leader, try_within_pairs):
        if tried(search) and (found := _settled(search, usual)):
            return found, None
    return replace(unexplained, fits=usual), None


def _settled(search: EffectSearch, usual: dict[Names, Fit]) -> Shared | None:
    """The verdict under other conventions if it may stand, or its refusal, which rests on the ``usual`` fits."""
    found = _judged(search)
    if refused := _refused_for_the_other_sign(search, found):
        return replace(refused, fits=usual)
    return found if _is_conclusive(search, found) else None


def _is_conclusive(search: EffectSearch, found: Shared) -> bool:
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


def _unless_a_formula(search: EffectSearch, most: tuple[Verdict, Partial] | None) -> tuple[Shared, Partial] | None:
    """The verdict that one effect repairs most of the misfit, unless a formula without it explains everything."""
    if most is None or outdone_by_a_formula(search, most[0], search.fits):
        return None
    verdict, partial = most
    return Shared(verdict, search.fits, search.fits[verdict.effects]), partial


def _residual_formula(
    search: EffectSearch, verdict: Verdict, refused_for: SuggestedFormula | None
) -> SuggestedFormula | None:
    """A formula for the remaining misfit, where no set explains all: the one that a claim was ``refused_for``."""
    if verdict.status not in INCOMPLETE or refused_for is not None:
        return refused_for
    partial = verdict.status == "partial"
    found = formula_on_top_of(search, [verdict.effects]) if partial else formula_to_try(search)
    return found if found is not None and repairs_something(search, found) else None


def _telling(trials: Sequence[NextTrial], criteria: Criteria) -> list[NextTrial]:
    """The trials that are worthwhile."""
    return [trial for trial in trials if trial.expected_gap_sd > criteria.telling_sd]


def _controls(search: EffectSearch, verdict: Verdict) -> dict[str, str]:
    """The control of each effect in which the alternatives differ, where there is one."""
    sets = verdict.alternatives
    differing = [name for name in dict.fromkeys(chain(*sets)) if not all(name in names for names in sets)]
    return {name: control for name in differing if (control := search.effects[name].control)}


def _most_discriminating(trials: Sequence[NextTrial], controls: Mapping[str, str], criteria: Criteria) -> str:
    """The trial that best discriminates between the alternatives, or their controls if none does."""
    telling = _telling(trials, criteria)
    if not telling:
        listed = ", ".join(f"{name} ({control})" for name, control in controls.items())
        of_another_kind = f"; control experiments do: {listed}" if listed else ": another kind is needed"
        return f"no trial within this range of φ and ω tells them apart by these observables{of_another_kind}"
    best = telling[0]
    gap = f"{best.expected_gap_sd:.1f} standard deviations of one {best.kind}"
    return f"most telling: {best.observable} at {best.where} ({gap})"


def _not_excluded(
    hidden: Sequence[str], trials: Sequence[NextTrial], out_of_reach: Sequence[str], search: EffectSearch
) -> str:
    """The effects that these data cannot exclude, the trials that would reveal them, and those that none would."""
    shown = {trial.separates[1]: trial for trial in reversed(_telling(trials, search.criteria))}
    how = "; ".join(f"{name}: {trial.observable} at {trial.where}" for name, trial in shown.items())
    remarks = [f"what would show {how}"] if how else []
    if out_of_reach:
        these = one_value.where(search.cells) or "like these"
        remarks.append(f"not within reach of {search.cells.trials} more trials {these}: {', '.join(out_of_reach)}")
    return f"at their usual strength these would not show in the data: {', '.join(hidden)}" + (
        f" ({'; '.join(remarks)})" if remarks else ""
    )


def _stability(fits: Sets, others: Sequence[Fit], verdict: Verdict, criteria: Criteria) -> float:
    # What is partial leads the single effects only: larger sets may fit better, and are not to be believed.
    if verdict.status in ("untested", *INCOMPLETE):
        return float("nan")
    named = verdict.alternatives or ((),)
    leading = sorted((fit for fit in (*fits.values(), *others) if sound(fit)), key=lambda fit: fit.bic)[:LEADING]
    leading += [fits[names] for names in named if fits[names] not in leading]
    shares = win_shares(leading, np.random.default_rng(0), criteria=criteria)
    return sum(share for fit, share in zip(leading, shares, strict=True) if fit.effects in named)
