"""Effects whose formulas have another form than the catalogue's: is the family named, is another one?

python benchmarks/variants.py [--seeds 6] [--only FAMILY] [--out runs/variants.jsonl] [--workers N]    resumes

Trials are drawn from the project's own chain, in which a formula stands for the effect.
"""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from _drawn import drawn
from _figures import Figure, share
from _matrix import Matrix, collect, options
from hidden import OMEGA, PHI
from sandbot_model.data.conditions import Cells, cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.result import Discovery
from sandbot_model.fitting.fit import Fit, fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Walker
from sandbot_record.trials.table import Trials

SEEDS, QUICK_SEEDS, REPLICATES, MAX_EFFECTS, EVERY = 6, 1, 3, 2, 5
OUT = Path("runs/variants.jsonl")
ALIKE = frozenset({"leg_slip", "cable_drag", "bed_slope"})
"""Told apart by how they vary with depth alone: of these one may stand for another in a set."""
TOLD = 12.0
"""Deviance by which a wrong model must miss what trials can tell from it (shared/physics.md, 7)."""
NAMED = ("identified", "partial", "ambiguous")
NOT_TOLD = "not to be told"


@dataclass(frozen=True)
class Form:
    """A formula in the place of a family's own, its numbers put in (forms.yaml)."""

    family: str
    name: str
    stages: Mapping[str, str]
    lab: str = ""

    @property
    def walker(self) -> Walker:
        """The chain in which it acts."""
        texts = enumerate(f"{stage}: {text}" for stage, text in self.stages.items())
        return Walker(tuple(formula_effect(f"hidden{at}: {text}") for at, text in texts))


def _read(name: str) -> Any:
    return yaml.load(Path(__file__).with_name(name).read_bytes(), yaml.CSafeLoader)


OUTSIDE = "outside the catalogue"
"""The family of a world that is of none."""
FORMS = [
    *(
        Form(family, name, stages, lab)
        for lab, families in _read("forms.yaml").items()
        for family, forms in families.items()
        for name, stages in forms.items()
    ),
    *(Form(OUTSIDE, name, stages, lab) for lab, some in _read("outside.yaml").items() for name, stages in some.items()),
]


@dataclass(frozen=True)
class Case:
    """One campaign to analyse."""

    lab: str
    family: str
    form: str
    seed: int


def cases(seeds: int, only: Sequence[str] = ()) -> list[Case]:
    """Seed by seed, so that a run stopped early has something of every form."""
    return [
        Case(form.lab, form.family, form.name, seed)
        for seed in range(seeds)
        for form in FORMS
        if not only or form.family in only
    ]


def campaign(form: Form, seed: int) -> Trials:
    """A campaign of 7 φ × 7 ω × 3 in a world in which the form acts."""
    return drawn(form.walker, [{}] * len(form.stages), PHI, OMEGA, REPLICATES, seed)


def analyse(case: Case) -> dict[str, Any]:
    """What the analysis says of one campaign, and how that is to be judged."""
    form = next(one for one in FORMS if (one.lab, one.family, one.name) == (case.lab, case.family, case.form))
    cells = cells_of(campaign(form, 2000 + case.seed))
    found = discover(cells, catalogue(), max_effects=MAX_EFFECTS)
    said, told = outcome(case.family, found), np.nan
    if said == "false claim" or (said in NAMED and case.family == OUTSIDE):
        named = [one for one in (*found.fits, found.fit) if one.effects in found.verdict.alternatives]
        told = missed(form, cells, named)
        said = NOT_TOLD if told < TOLD else said
    return {**dataclasses.asdict(case), "outcome": said, "said": found.headline, "missed": told}


def missed(form: Form, cells: Cells, named: Sequence[Fit]) -> float:
    """How far the least deviance of what is named is above that of the form itself, fitted to the same trials."""
    effects = {effect.identifier: effect for effect in form.walker.effects}
    itself = fit(model_of("simple", tuple(effects), effects), cells)
    return min(one.deviance for one in named) - itself.deviance


def outcome(family: str, found: Discovery) -> str:
    """A column of the table. Another family named beside the true one is a false claim as well."""
    verdict = found.verdict
    if verdict.status not in NAMED or family == OUTSIDE:
        return verdict.status
    family_of = {name: "alike" if name in ALIKE else name for name in catalogue()}
    named = [frozenset(family_of[name] for name in one) for one in verdict.alternatives or (verdict.effects,)]
    if frozenset({family_of[family]}) not in named:
        return "half" if any(family_of[family] in one for one in named) else "false claim"
    return verdict.status


OUTCOMES = (*NAMED, "adequate", "unexplained", "half", NOT_TOLD, "false claim")
SHOWN = {NOT_TOLD: "indistinguishable"}
"""Outcomes with another heading than in the stored results."""


def report(results: Sequence[Mapping[str, Any]]) -> str:
    """A row for each form of one lab, and one for all, in Markdown."""
    heads = [SHOWN.get(one, one) for one in OUTCOMES]
    lines = ["| family | form | campaigns | " + " | ".join(heads) + " |", "|" + "---|" * (3 + len(heads))]
    for family, form in dict.fromkeys((one["family"], one["form"]) for one in results):
        lines.append(_row(family, form, [one for one in results if (one["family"], one["form"]) == (family, form)]))
    return "\n".join([*lines, _row("all", "", results)]) + "\n"


def _row(family: str, form: str, some: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(one["outcome"] for one in some)
    return f"| {family} | {form} | {len(some)} | {' | '.join(str(counts[one]) for one in OUTCOMES)} |"


def document(results: Sequence[Mapping[str, Any]]) -> str:
    """The whole report, in Markdown."""
    parts = [
        "# Effects whose formulas have another form",
        "",
        f"{len(results)} campaigns of {len(PHI)} φ × {len(OMEGA)} ω × {REPLICATES}, drawn from the project's own chain "
        f"with a formula of forms.yaml instead of a catalogue's effect; sets of up to {MAX_EFFECTS} effects. The "
        "authors of the first two labs and of the fourth to tenth knew only the catalogue's formulas, those of the "
        "third also what the first two had written. Wrong verdicts of the first to sixth lab, and false claims of the "
        "seventh to tenth, were analysed and led to conventions of their kind. "
        "`adequate`: the base model absorbs the form's effect, so nothing can be named. `half`: the family together "
        f"with another one. `{SHOWN[NOT_TOLD]}`: the named effect is absent, but its deviance is less than {TOLD:g} "
        "above that of the form itself for the same trials. leg_slip, cable_drag and bed_slope count as one family.",
    ]
    for lab in dict.fromkeys(form.lab for form in FORMS):
        if some := [one for one in results if one["lab"] == lab and one["family"] != OUTSIDE]:
            parts += ["", f"## The {lab} lab's", "", *_shares(some), "", report(some)]
    if some := [one for one in results if one["family"] == OUTSIDE]:
        parts += ["", "## Outside the catalogue", "", _claimed(some), "", report(some)]
    return "\n".join(parts)


def _claimed(some: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(one["outcome"] for one in some)
    claimed, told = sum(counts[one] for one in NAMED), len(some) - counts[NOT_TOLD]
    return (
        f"* an absent family: identified {counts['identified']}, ambiguous {counts['ambiguous']}, partial "
        f"{counts['partial']} of {told} distinguishable worlds ({claimed / told:.0%}; target ≤ 5 %); "
        f"{counts[NOT_TOLD]} more are called something that their trials can't distinguish from them"
    )


def _shares(some: Sequence[Mapping[str, Any]]) -> list[str]:
    counts = Counter(one["outcome"] for one in some)
    told = len(some) - counts["adequate"] - counts[NOT_TOLD]
    named = sum(counts[one] for one in NAMED)
    return [
        f"* right family named, partial or in the set: {named} of {told} distinguishable forms ({named / told:.0%}, "
        f"target ≥ 90 %; {counts['adequate']} are adequate, {counts[NOT_TOLD]} indistinguishable from what is named)",
        f"* another family: {counts['false claim']} of {len(some)} ({counts['false claim'] / len(some):.0%}; target "
        f"≤ 2 %), another together with the right one: {counts['half']}",
    ]


def _figures_of(results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    outcomes = [one["outcome"] for one in results if one["family"] != OUTSIDE]
    outside = [one["outcome"] for one in results if one["family"] == OUTSIDE]
    claimed = [one in NAMED for one in outside if one != NOT_TOLD]
    told = [one in NAMED for one in outcomes if one not in ("adequate", NOT_TOLD)]
    false = [one == "false claim" for one in outcomes]
    return [
        *share("family named if its formula has another form", "campaigns", told, "≥ 90 %"),
        *share("another family named", "campaigns", false, "≤ 2 %"),
        *share("a family named that is absent", "worlds outside the catalogue", claimed, "≤ 5 %"),
    ]


_matrix = Matrix(analyse, lambda: cases(1)[::EVERY], lambda: cases(QUICK_SEEDS), OUT, document, _figures_of)
sample, main, figures = _matrix.sample, _matrix.main, _matrix.figures


def command() -> None:
    """Run what is missing of a part and print its report."""
    args = options(__doc__, SEEDS, OUT, "a family").parse_args()
    print(document(collect(analyse, cases(args.seeds, args.only), args.out, args.workers)))


if __name__ == "__main__":
    command()
