"""From trials to a verdict: is the base model adequate, and if not, which effects of the catalogue repair it.

None, then every single effect, then pairs (all among the survivors, the best with everybody), then triples: each set is
fitted to its global minimum and judged against the replicates. ``verdict`` draws the conclusion.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import Any

import numpy as np

from sandbot_common.robot import to_mapping
from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.alone import taken_back
from sandbot_model.discovery.calibration import beyond_belief, would_fall
from sandbot_model.discovery.candidates import Candidate, candidates
from sandbot_model.discovery.conventions import against, beside_the_leader, conventions, other_conventions, within_pairs
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.formula_search import formula_on_top_of, formula_to_try, outdone_by_a_formula
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.discovery.limits import Limit, limits
from sandbot_model.discovery.lone_trials import gone_wrong, told
from sandbot_model.discovery.next_trials import NextTrial, next_trials, trials_to_exclude
from sandbot_model.discovery.nuisances_about import averaged_over_scatter
from sandbot_model.discovery.partial import Partial, beyond_its_range, partly, repairs
from sandbot_model.discovery.plausibility import doubts, implausible_k
from sandbot_model.discovery.residual import SuggestedFormula
from sandbot_model.discovery.sharing import (
    Shared,
    as_granted,
    bends,
    nuisances_suffice,
    reconsidered,
    refitted_globally,
)
from sandbot_model.discovery.stability import win_shares
from sandbot_model.discovery.unseen import unseen
from sandbot_model.discovery.untested import repeats, untested
from sandbot_model.discovery.verdict import CLAIMS, Sets, Verdict, judge, only_with, sound
from sandbot_model.fitting.diagnose import StageTest, stage_tests
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.fitting.plain import data_summary, number, plain
from sandbot_model.fitting.profile import deepest
from sandbot_model.fitting.text import WIDTH, html_table, table
from sandbot_model.physics.effect import Effect

SCHEMA = "sandbot.discovery/2"
LEADING = 8
"""Sets compared in the bootstrap."""
LEAVES_A_REST = ("partial", "unexplained")
"""Verdicts after which something is left to explain."""


@dataclass(frozen=True, eq=False, repr=False)
class Discovery:
    """Everything ``discover`` found. ``steps`` is the ladder: the base model, then one more effect a step."""

    model: str
    cells: Cells
    noise_floor_m_s: float
    noise_floor: Mapping[str, float]
    steps: tuple[Fit, ...]
    candidates: tuple[Candidate, ...]
    verdict: Verdict
    next_trials: tuple[NextTrial, ...]
    stability: float = float("nan")
    """Share of bootstrap draws in which the named set, or one of its alternatives, is best among the leading sets."""
    unseen: tuple[str, ...] = ()
    """If the base model is adequate: effects that could be there at their usual strength and not show in these data."""
    stages: tuple[StageTest, ...] = ()
    """Where in the chain the base model fails."""
    residual: SuggestedFormula | None = None
    """If nothing of the catalogue fits: what is left, in the field's terms, as a formula to try."""
    fits: tuple[Fit, ...] = ()
    """Every set that was tried, the best BIC first."""
    partial: Partial | None = None
    """If one effect repairs most of the base model: how much, where it holds, where it fails."""
    variants: Mapping[str, str] = field(default_factory=dict)
    """Effects named whose formula holds under another convention than the catalogue's, and which that is."""
    limits: tuple[Limit, ...] = ()
    """Of effects that are absent, at 95 %."""
    criteria: Criteria = DEFAULT
    """What it took to claim an effect."""

    @property
    def fit(self) -> Fit:
        """The last step of the ladder: the set that the verdict names, or the base model."""
        return self.steps[-1]

    def to_dict(self) -> dict[str, Any]:
        """Plain data of schema ``sandbot.discovery/2``; numbers that are not known are None."""
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
            "unseen": list(self.unseen),
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
        if self.verdict.status == "ambiguous":
            sets = [" + ".join(map(self.in_words, names)) for names in self.verdict.alternatives]
            return f"ambiguous: one of {len(sets)} sets: {'; '.join(sets)}"
        named = " + ".join(map(self.in_words, self.verdict.effects))
        return f"{self.verdict.status}: {named}" if named else self.verdict.status

    @property
    def stability_in_words(self) -> str:
        """How often the set named, or one of those that explain the data alike, is best; empty if none is named."""
        if not np.isfinite(self.stability) or self.verdict.status == "unexplained":
            return ""
        which = "one of these is the" if self.verdict.status == "ambiguous" else ""
        return f"{which} best in {100 * self.stability:.0f} % of bootstrap draws".strip()

    def in_words(self, effect: str) -> str:
        """An effect with the convention it holds under, where that is another than the catalogue's."""
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

    ``criteria`` say what it takes to claim an effect, ``fit_all`` maps the fits (see ``parallel``) and ``progress``
    hears (stage, done, total). Nothing is searched for where the robot is doubted (see ``plausibility``). Where nothing
    explains all trials, those alone and far off are left out if that explains the others (see ``lone_trials``).
    """
    how: dict[str, Any] = {"base": base, "criteria": criteria, "fit_all": fit_all, "progress": progress}
    found = _discovered(cells, effects, max_effects, **how)
    if found.verdict.status not in LEAVES_A_REST or not len(wrong := gone_wrong(found.fits[0], criteria)):
        return found
    others = _discovered(cells.without(wrong), effects, max_effects, **how)
    if others.verdict.status in LEAVES_A_REST:
        return found
    because = f"{others.verdict.because}; {told(cells, wrong)}"
    return replace(others, verdict=replace(others.verdict, because=because))


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
    doubted = doubts(cells)
    at_once = _of_another_robot(doubted) if doubted else untested(cells, criteria)
    found, partial = _found(search, at_once, max_effects)
    search.fits, verdict, named = found.fits, found.verdict, found.named
    search.effects = {**effects, **named.model.catalogue}
    # Steps below leave something to explain: how well their parameters are known means nothing, and is not sampled.
    below = search.ladder(verdict)[:-1]
    named, reported = _reported(search, named)
    floor = noise_floor(cells)
    hidden, trials = _next(search, verdict, named)
    verdict = _in_full(search, verdict, named, hidden, trials)
    return Discovery(
        model=base,
        cells=cells,
        noise_floor_m_s=floor["speed"],
        noise_floor=floor,
        steps=(*below, reported),
        candidates=tuple(candidates(search.fits, effects)),
        verdict=verdict,
        next_trials=tuple(trials),
        unseen=tuple(fit.effects[0] for fit in hidden),
        stability=float("nan") if verdict.status == "untested" else _stability(search.fits, verdict, criteria),
        stages=stage_tests(search.fits[()]),
        residual=_residual_formula(search, verdict) if not doubted else None,
        partial=partial,
        variants=conventions([search.fits[names] for names in verdict.alternatives]),
        limits=tuple(limits(search, named)) if verdict.status in ("adequate", "identified") else (),
        fits=tuple(sorted(search.fits.values(), key=lambda fit: fit.bic)),
        criteria=criteria,
    )


def _found(search: EffectSearch, at_once: Verdict | None, max_effects: int) -> tuple[Shared, Partial | None]:
    """The verdict after a search, or ``at_once`` without one; and what one effect repairs where that is but a part."""
    search.run(0 if at_once else max_effects, lambda size: nuisances_suffice(search, size))
    found = Shared(at_once, search.fits, search.fits[()]) if at_once else _beside_nuisances(search)
    partial = None
    if found.verdict.status in CLAIMS and against(search, search.fits[found.verdict.effects]):
        found = _beside_nuisances(search)
    found = _imitated(search, found) or found
    # From one observable alone no convention can be told from another; where no effect was tried there is none.
    searched = not at_once and len(search.fits) > 1
    if found.verdict.status == "unexplained" and searched and len(search.cells.observables) > 1:
        found, partial = _under_other_conventions(search, found)
    return found, partial


def _by_reported_errors(search: EffectSearch, found: Shared) -> Shared:
    """The verdict with the standard errors that are reported: where a derivative takes a valley for wider than it is, a
    number beyond its plausible range passes for one that may be within."""
    if found.verdict.status not in CLAIMS or sound(reported := _reported(search, found.named)[1]):
        return found
    return Shared(only_with(reported), search.fits, search.fits[()])


def _reported(search: EffectSearch, named: Fit) -> tuple[Fit, Fit]:
    """The deepest believable fit of a set, and the same with the standard errors that are reported."""
    if named not in search.reported:
        search.reported[named] = _with_errors(named, search.criteria)
    return search.reported[named]


def _with_errors(named: Fit, criteria: Criteria) -> tuple[Fit, Fit]:
    lower = deepest(refitted_globally(named))
    # Along a flat valley the lowest place may be where nobody believes it.
    named = lower if sound(lower) or not sound(named) else named
    return named, averaged_over_scatter(named, criteria) if named.nuisances else with_sampled_errors(named)


def _next(search: EffectSearch, verdict: Verdict, named: Fit) -> tuple[list[Fit], list[NextTrial]]:
    """Effects that could hide if the base model is adequate, and the trials to run next."""
    if hidden := unseen(search, named) if verdict.status == "adequate" else []:
        return hidden, trials_to_exclude(search.fits[()], hidden)
    if verdict.status == "untested":
        return [], repeats(search.cells)
    return [], next_trials([search.fits[names] for names in verdict.alternatives])


def _in_full(
    search: EffectSearch, verdict: Verdict, named: Fit, hidden: Sequence[Fit], trials: Sequence[NextTrial]
) -> Verdict:
    """The verdict with what a reader should know beside it."""
    because = [verdict.because]
    if strange := implausible_k(search.fits[()]):
        because.append(strange)
    if hidden:
        because.append(_not_excluded(hidden, trials, search.criteria))
    if verdict.status == "ambiguous":
        because.append(_most_telling(trials, search.criteria))
    if verdict.status == "identified":
        because.append(would_fall(search, named))
    # Where the robot is doubted there was no search, and no reading is to be blamed.
    if verdict.status == "unexplained" and len(search.fits) > 1:
        because.append(beyond_belief(search))
    if verdict.status in ("identified", "partial"):
        because += [f"{one.mistaken_for} can look the same" for one in named.model.effects if one.mistaken_for]
    return replace(verdict, because="; ".join(filter(None, because)))


def _imitated(search: EffectSearch, found: Shared) -> Shared | None:
    """The refusal of a claim that a formula outdoes: one of several effects, one under another convention than the
    catalogue's, which was picked from dozens, or one that needs what trials share."""
    if found.verdict.status not in CLAIMS:
        return None
    picked = len(found.verdict.effects) > 1 or bool(conventions([found.fits[found.verdict.effects]]))
    if not picked and judge(search.fits, search.criteria).status != "unexplained":
        return None
    refused = outdone_by_a_formula(search, found.verdict, as_granted(search, found))
    return None if refused is None else Shared(refused, dict(search.fits), search.fits[()])


def _beside_nuisances(search: EffectSearch) -> Shared:
    """The verdict on what was tried, beside what trials share."""
    search.weigh_doubts()
    plain = judge(search.fits, search.criteria)
    found = reconsidered(search, plain) or Shared(plain, search.fits, search.fits[plain.effects])
    refused = taken_back(found.verdict, found.fits)
    if refused is not None:
        return Shared(refused, search.fits, search.fits[()])
    return _by_reported_errors(search, found)


def _under_other_conventions(search: EffectSearch, unexplained: Shared) -> tuple[Shared, Partial | None]:
    """Where no set of the catalogue fits: under another convention one effect may, or repair most, or two may."""
    usual = dict(search.fits)
    better = other_conventions(search)
    # A formula that nobody wrote down is no claim where one of the catalogue fits clearly better with a number nobody
    # believes.
    most = beyond_its_range(search)
    if most and not conventions([search.fits[most[0].effects]]) and (part := _in_part(search, most)):
        return part
    if better and _stands(search, found := _beside_nuisances(search)):
        return found, None
    for fits in (usual, search.fits):
        search.fits = fits
        if part := _in_part(search, partly(search)):
            return part
    for tried in (beside_the_leader, within_pairs):
        if tried(search) and _stands(search, found := _beside_nuisances(search)):
            return found, None
    return replace(unexplained, fits=usual), None


def _stands(search: EffectSearch, found: Shared) -> bool:
    """Whether a verdict under other conventions is one: no claim is that needs offsets of each batch as well, for more
    than a small rest."""
    if found.verdict.status not in CLAIMS:
        return found.verdict.status != "unexplained"
    sets = found.verdict.alternatives
    needed = bends(found.named) and not all(repairs(search.fits, names, search.criteria) for names in sets)
    bent = needed and conventions([search.fits[names] for names in sets])
    return not bent and _imitated(search, found) is None


def _in_part(search: EffectSearch, most: tuple[Verdict, Partial] | None) -> tuple[Shared, Partial] | None:
    """The verdict that one effect repairs most, unless a formula without it explains all."""
    if most is None or outdone_by_a_formula(search, most[0], search.fits):
        return None
    verdict, partial = most
    return Shared(verdict, search.fits, search.fits[verdict.effects]), partial


def _residual_formula(search: EffectSearch, verdict: Verdict) -> SuggestedFormula | None:
    """What is left where no set repairs the model, as a formula."""
    if verdict.status == "partial":
        return formula_on_top_of(search, [verdict.effects])
    return formula_to_try(search) if verdict.status == "unexplained" else None


def _of_another_robot(doubted: Sequence[str]) -> Verdict:
    because = f"robot.yaml may be wrong, so nothing is identified: {'; '.join(doubted)}"
    return Verdict("unexplained", (), (), because)


def _most_telling(trials: Sequence[NextTrial], criteria: Criteria) -> str:
    """What would tell the alternatives apart."""
    telling = [trial for trial in trials if trial.expected_gap_sd > criteria.telling_sd]
    if not telling:
        return "no trial within this range of φ and ω tells them apart by these observables: another kind is needed"
    best = telling[0]
    gap = f"{best.expected_gap_sd:.1f} standard deviations of one trial"
    return f"most telling: {best.observable} at {best.where} ({gap})"


def _not_excluded(hidden: Sequence[Fit], trials: Sequence[NextTrial], criteria: Criteria) -> str:
    """Which effects could hide in these data, and what would show them."""
    names = ", ".join(fit.effects[0] for fit in hidden)
    shown = {trial.separates[1]: trial for trial in reversed(trials) if trial.expected_gap_sd > criteria.telling_sd}
    how = "; ".join(f"{name}: {trial.observable} at {trial.where}" for name, trial in shown.items())
    return f"at their usual strength these would not show in it: {names}" + (f" (what would show {how})" if how else "")


def _stability(fits: Sets, verdict: Verdict, criteria: Criteria) -> float:
    named = verdict.alternatives or ((),)
    leading = sorted((fit for fit in fits.values() if sound(fit)), key=lambda fit: fit.bic)[:LEADING]
    leading += [fits[names] for names in named if fits[names] not in leading]
    shares = win_shares(leading, np.random.default_rng(0), criteria=criteria)
    return sum(share for fit, share in zip(leading, shares, strict=True) if fit.effects in named)
