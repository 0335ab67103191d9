"""What is said beside a verdict: what comes next, calibration errors, hidden effects, the most telling trial."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from sandbot_model.data.regime import walks
from sandbot_model.discovery import batches_apart, one_value, repeats
from sandbot_model.discovery.calibration_error import rival_calibration_error, sufficient_calibration_error
from sandbot_model.discovery.candidates import what_it_lacks
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.next_trials import NextTrial, Proposed
from sandbot_model.discovery.nuisances_in_words import confounded_drift
from sandbot_model.discovery.plausibility import implausible_k
from sandbot_model.discovery.untested import plainly_missed
from sandbot_model.discovery.verdict import RESPONSE_TIME, Verdict, is_determined, next_best
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.effect import Effect


def told_from_others(search: EffectSearch, verdict: Verdict, others: Sequence[Fit], family: Sequence[Fit]) -> Verdict:
    """The verdict with what comes next, ``others`` under other conventions included, and what its errors cover."""
    because = [verdict.because]
    if verdict.status == "identified":
        because.append(next_best(search.fits, search.fits[verdict.effects], others, search.criteria))
    if family:
        because.append("standard errors cover other forms of the formula that fit as well")
    return replace(verdict, because="; ".join(filter(None, because)))


def remarked(
    search: EffectSearch,
    verdict: Verdict,
    named: Fit,
    hidden: Sequence[str],
    proposed: Proposed,
    controls: Mapping[str, str],
) -> Verdict:
    """The verdict with remarks: calibration errors, hidden effects, the most informative trial, look-alikes."""
    remarks = [implausible_k(search.fits[()]), repeats.in_words(repeats.odd_one_out(verdict, named), named)]
    remarks.append(batches_apart.in_words(named, search.criteria))
    if verdict.status == "adequate":
        remarks.append(too_few_walked(search.fits[()]))
        remarks.append(what_it_lacks(search.fits, search.criteria))
    if hidden:
        remarks.append(not_excluded(hidden, proposed, search))
    if len(verdict.alternatives) > 1:
        remarks.append(most_discriminating(proposed.trials, controls, search.criteria))
    if verdict.status in one_value.WIDENED:
        remarks.append(one_value.in_words(search.cells))
    if verdict.status == "identified":
        remarks.append(unknown_response_time(named))
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


def controls_of(search: EffectSearch, verdict: Verdict) -> dict[str, str]:
    """The control of each effect in which the alternatives differ, where there is one."""
    sets = verdict.alternatives
    differing = [name for name in dict.fromkeys(chain(*sets)) if not all(name in names for names in sets)]
    return {name: control for name in differing if (control := search.effects[name].control)}


def too_few_walked(base: Fit) -> str:
    """That a model of walking is hardly tested, where what walked does not determine Δt; empty where it does, where
    nothing swam, and where trials at a single ω or φ are the reason."""
    walking, known = walks(base.cells.mean), np.isfinite(base.parameters[RESPONSE_TIME].stderr)
    if known or walking.all() or one_value.single(base.cells):
        return ""
    conditions = len(walking)
    swam = (
        f"only {walking.sum()} of {conditions} conditions walked"
        if walking.any()
        else f"all {conditions} conditions swam"
    )
    return f"{swam}, so walking is hardly tested and Δt not known: run lower ω or higher φ"


def unknown_response_time(named: Fit) -> str:
    """That a claim rests on a Δt which the data do not determine, and what does; empty where they do."""
    if is_determined(*named.parameters[RESPONSE_TIME]):
        return ""
    asked = one_value.in_words(named.cells) or "walk at more values of ω"
    return (
        f"Δt is not known beside it, so something outside the catalogue may pass for it; before you rely on it: {asked}"
    )


def worthwhile(trials: Sequence[NextTrial], criteria: Criteria) -> list[NextTrial]:
    """The trials that are worthwhile."""
    return [trial for trial in trials if trial.expected_gap_sd > criteria.telling_sd]


def _mistaken(effect: Effect) -> str:
    """What no trial distinguishes from an effect, and the control experiment that does."""
    control = f"; a control experiment on {effect.identifier} decides ({effect.control})" if effect.control else ""
    return f"{effect.mistaken_for} would look the same{control}"


def most_discriminating(trials: Sequence[NextTrial], controls: Mapping[str, str], criteria: Criteria) -> str:
    """The trial that best discriminates between the alternatives, or their controls if none does."""
    telling = worthwhile(trials, criteria)
    if not telling:
        listed = ", ".join(f"{name} ({control})" for name, control in controls.items())
        of_another_kind = f"; control experiments do: {listed}" if listed else ": another kind is needed"
        return f"no trial within this range of φ and ω tells them apart by these observables{of_another_kind}"
    best = telling[0]
    gap = f"{best.expected_gap_sd:.1f} standard deviations of one {best.kind}"
    return f"most telling: {best.observable} at {best.where} ({gap})"


def not_excluded(hidden: Sequence[str], proposed: Proposed, search: EffectSearch) -> str:
    """The effects that these data cannot exclude, the trials that would reveal them, and those that none would."""
    where: dict[str, list[str]] = {}
    for name, trial in proposed.shown.items():
        if worthwhile([trial], search.criteria):
            where.setdefault(f"{trial.observable} at {trial.where}", []).append(name)
    how = "; ".join(f"{', '.join(names)}: {measured}" for measured, names in where.items())
    remarks = [f"what would show {how}"] if how else []
    if proposed.out_of_reach:
        these, names = one_value.where(search.cells) or "like these", ", ".join(proposed.out_of_reach)
        remarks.append(f"not within reach of {search.cells.trials} more trials {these}: {names}")
    return f"at their usual strength these would not show in the data: {', '.join(hidden)}" + (
        f" ({'; '.join(remarks)})" if remarks else ""
    )
