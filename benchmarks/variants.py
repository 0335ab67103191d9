"""Effects whose formulas have another form than the catalogue's: is the family named, is another one?

python benchmarks/variants.py [--seeds 6] [--only FAMILY] [--out runs/variants.jsonl] [--workers N]    resumes

Trials are drawn from the project's own chain, in which a formula stands for the effect.
"""

import argparse
import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import least_squares

from _drawn import DELTA_T_S, GROUND, NOISE, drawn
from _figures import Figure, share
from _matrix import Matrix, collect
from hidden import OMEGA, PHI
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import Discovery, discover
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.walking import Inputs, Walker
from sandbot_record.trials.table import Trials

SEEDS, QUICK_SEEDS, REPLICATES, MAX_EFFECTS, EVERY = 6, 1, 3, 2, 5
OUT = Path("runs/variants.jsonl")
ALIKE = frozenset({"leg_slip", "cable_drag", "bed_slope"})
"""Told apart by how they vary with depth alone: of these one may stand for another in a set."""
SAME = 1e-4
"""Largest gap to a form, in standard deviations of a trial, up to which another formula says the same."""


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
    return yaml.safe_load(Path(__file__).with_name(name).read_text(encoding="utf-8"))


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
    found = discover(cells_of(campaign(form, 2000 + case.seed)), catalogue(), max_effects=MAX_EFFECTS)
    said = outcome(case.family, found)
    if said == "false claim" and found.verdict.status == "identified" and same_formula(form, found.fit):
        said = "same formula"
    return {**dataclasses.asdict(case), "outcome": said, "said": found.headline}


def same_formula(form: Form, named: Fit) -> bool:
    """Whether what is named predicts the form's own observables at some values of its parameters: no data can tell."""
    phi, omega = (axis.ravel() for axis in np.meshgrid(PHI, OMEGA))
    inputs = Inputs(GROUND(phi), omega, DELTA_T_S, phi, k_of_phi=GROUND)
    effects, values = named.model.walker.effects, {name: one.value for name, one in named.parameters.items()}
    names = [(effect.identifier, one.name) for effect in effects for one in effect.parameters]
    true = form.walker.predict(inputs, [{}] * len(form.stages)).observables

    def gap(at: Array) -> Array:
        own = {name: value for name, value in zip(names, at, strict=True)}
        params = [{one.name: own[effect.identifier, one.name] for one in effect.parameters} for effect in effects]
        return ((Walker(effects).predict(inputs, params).observables - true) / NOISE).ravel()

    start = [values[f"{effect}.{name}"] for effect, name in names]
    return bool(np.abs(least_squares(gap, start, xtol=1e-12, ftol=1e-12).fun).max() < SAME)


def outcome(family: str, found: Discovery) -> str:
    """A column of the table. Another family named beside the true one is a false claim as well."""
    verdict = found.verdict
    if verdict.status not in ("identified", "partial", "ambiguous") or family == OUTSIDE:
        return verdict.status
    family_of = {name: "alike" if name in ALIKE else name for name in catalogue()}
    named = [frozenset(family_of[name] for name in one) for one in verdict.alternatives or (verdict.effects,)]
    if frozenset({family_of[family]}) not in named:
        return "half" if any(family_of[family] in one for one in named) else "false claim"
    return verdict.status


NAMED = ("identified", "partial", "ambiguous")
OUTCOMES = (*NAMED, "adequate", "unexplained", "half", "same formula", "false claim")


def report(results: Sequence[Mapping[str, Any]]) -> str:
    """A row for each form of one lab, and one for all, in Markdown."""
    lines = ["| family | form | campaigns | " + " | ".join(OUTCOMES) + " |", "|" + "---|" * (3 + len(OUTCOMES))]
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
        f"with a formula of forms.yaml in the place of a catalogue's effect; up to {MAX_EFFECTS} effects. The first "
        "two labs, the fourth, fifth, sixth and seventh knew the catalogue's formulas and nothing else, the third what "
        "the first two had written. What came out wrong of the first to sixth was looked at and has conventions of its "
        "kind, of the seventh what was claimed in part. "
        "`adequate`: the base model takes in what the form does, nothing is left to be told. `half`: the family, and "
        "another beside it. `same formula`: another family is named, whose own formula predicts what the form does, "
        f"all observables within {SAME:g} standard deviations of a trial: no data can tell the two apart. leg_slip, "
        "cable_drag and bed_slope count as one family.",
    ]
    for lab in dict.fromkeys(form.lab for form in FORMS):
        if some := [one for one in results if one["lab"] == lab and one["family"] != OUTSIDE]:
            parts += ["", f"## The {lab} lab's", "", *_shares(some), "", report(some)]
    if some := [one for one in results if one["family"] == OUTSIDE]:
        parts += ["", "## Outside the catalogue", "", _claimed(some), "", report(some)]
    return "\n".join(parts)


def _claimed(some: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(one["outcome"] for one in some)
    claimed = sum(counts[one] for one in NAMED)
    return (
        f"* a family that does not act: identified {counts['identified']}, ambiguous {counts['ambiguous']}, partial "
        f"{counts['partial']} of {len(some)} ({claimed / len(some):.0%}; asked ≤ 5 %)"
    )


def _shares(some: Sequence[Mapping[str, Any]]) -> list[str]:
    counts = Counter(one["outcome"] for one in some)
    told = len(some) - counts["adequate"] - counts["same formula"]
    named = sum(counts[one] for one in NAMED)
    return [
        f"* right family named, partial or in the set: {named} of {told} that can be told ({named / told:.0%}, asked "
        f"≥ 90 %; {counts['adequate']} are adequate, {counts['same formula']} the same formula as another family's)",
        f"* another family: {counts['false claim']} of {len(some)} ({counts['false claim'] / len(some):.0%}; asked "
        f"≤ 2 %), another beside the right one: {counts['half']}",
    ]


def _figures_of(results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    outcomes = [one["outcome"] for one in results if one["family"] != OUTSIDE]
    claimed = [one["outcome"] in NAMED for one in results if one["family"] == OUTSIDE]
    told = [one in NAMED for one in outcomes if one not in ("adequate", "same formula")]
    false = [one == "false claim" for one in outcomes]
    return [
        *share("family named though its formula has another form", "campaigns", told, "≥ 90 %"),
        *share("another family named", "campaigns", false, "≤ 2 %"),
        *share("a family named that does not act", "worlds outside the catalogue", claimed, "≤ 5 %"),
    ]


_matrix = Matrix(analyse, lambda: cases(1)[::EVERY], lambda: cases(QUICK_SEEDS), OUT, document, _figures_of)
sample, main, figures = _matrix.sample, _matrix.main, _matrix.figures


def command() -> None:
    """Run what is missing of a part and print its report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--only", action="append", default=[], help="a family; may be given again")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--workers", type=int)
    args = parser.parse_args()
    print(document(collect(analyse, cases(args.seeds, args.only), args.out, args.workers)))


if __name__ == "__main__":
    command()
