"""Effects whose formulas have another form than the catalogue's: is the family named, is another one?

python benchmarks/variants.py [--seeds 6] [--only FAMILY] [--out runs/variants.jsonl] [--workers N]    resumes

Trials are drawn from the project's own chain, in which a formula stands for the effect.
"""

import argparse
import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from _drawn import drawn
from _figures import Figure, share
from _matrix import collect
from hidden import OMEGA, PHI
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import Discovery, discover
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.walking import Walker
from sandbot_record.trials.table import Trials

SEEDS, QUICK_SEEDS, REPLICATES, MAX_EFFECTS, EVERY = 6, 1, 3, 2, 5
OUT = Path("runs/variants.jsonl")
ALIKE = frozenset({"leg_slip", "cable_drag", "bed_slope"})
"""Told apart by how they vary with depth alone: of these one may stand for another in a set."""


@dataclass(frozen=True)
class Form:
    """A formula in the place of a family's own, its numbers put in (forms.yaml)."""

    family: str
    name: str
    stage: str
    text: str
    lab: str = ""


FORMS = [
    Form(family, name, stage, text, lab)
    for lab, families in yaml.safe_load(Path(__file__).with_name("forms.yaml").read_text(encoding="utf-8")).items()
    for family, forms in families.items()
    for name, form in forms.items()
    for stage, text in form.items()
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
    walker = Walker((formula_effect(f"hidden: {form.stage}: {form.text}"),))
    return drawn(walker, [{}], PHI, OMEGA, REPLICATES, seed)


def analyse(case: Case) -> dict[str, Any]:
    """What the analysis says of one campaign, and how that is to be judged."""
    form = next(one for one in FORMS if (one.lab, one.family, one.name) == (case.lab, case.family, case.form))
    found = discover(cells_of(campaign(form, 2000 + case.seed)), catalogue(), max_effects=MAX_EFFECTS)
    return {**dataclasses.asdict(case), "outcome": outcome(case.family, found), "said": found.headline}


def outcome(family: str, found: Discovery) -> str:
    """A column of the table. Another family named beside the true one is a false claim as well."""
    verdict = found.verdict
    if verdict.status not in ("identified", "partial", "ambiguous"):
        return verdict.status
    family_of = {name: "alike" if name in ALIKE else name for name in catalogue()}
    named = [frozenset(family_of[name] for name in one) for one in verdict.alternatives or (verdict.effects,)]
    if frozenset({family_of[family]}) not in named:
        return "half" if any(family_of[family] in one for one in named) else "false claim"
    return verdict.status


OUTCOMES = ("identified", "partial", "ambiguous", "adequate", "unexplained", "half", "false claim")


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
        f"with a formula of forms.yaml in the place of a catalogue's effect; up to {MAX_EFFECTS} effects. The forms "
        "are those of two labs that knew the catalogue's formulas and nothing else. `adequate`: the base model takes "
        "in what the form does, nothing is left to be told. `half`: the family, and another beside it. leg_slip, "
        "cable_drag and bed_slope count as one family.",
    ]
    for lab in dict.fromkeys(form.lab for form in FORMS):
        if some := [one for one in results if one["lab"] == lab]:
            parts += ["", f"## The {lab} lab's", "", *_shares(some), "", report(some)]
    return "\n".join(parts)


def _shares(some: Sequence[Mapping[str, Any]]) -> list[str]:
    counts = Counter(one["outcome"] for one in some)
    told = len(some) - counts["adequate"]
    named = counts["identified"] + counts["partial"] + counts["ambiguous"]
    return [
        f"* right family named, partial or in the set: {named} of {told} that are not adequate ({named / told:.0%}, "
        "asked ≥ 90 %)",
        f"* another family: {counts['false claim']} of {len(some)} ({counts['false claim'] / len(some):.0%}; asked "
        f"≤ 2 %), another beside the right one: {counts['half']}",
    ]


def sample() -> list[Figure]:
    """Every so many forms, once."""
    with ProcessPoolExecutor() as pool:
        outcomes = [one["outcome"] for one in pool.map(analyse, cases(1)[::EVERY])]
    told = [one in ("identified", "partial", "ambiguous") for one in outcomes if one != "adequate"]
    false = [one == "false claim" for one in outcomes]
    return [
        *share("family named though its formula has another form", "campaigns", told, "≥ 90 %"),
        *share("another family named", "campaigns", false, "≤ 2 %"),
    ]


def main() -> str:
    """One campaign of every form: what `make bench` has time for."""
    return document(collect(analyse, cases(QUICK_SEEDS), OUT))


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
