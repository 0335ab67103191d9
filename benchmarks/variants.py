"""Effects whose formulas have another form than the catalogue's: is the family named, is another one?

python benchmarks/variants.py [--seeds 6] [--only FAMILY] [--out runs/variants.jsonl] [--workers N]    resumes

Trials are drawn from the project's own chain, in which a formula stands for the effect. ``known`` are the forms that
the catalogue's variants have; all others are nobody's.
"""

import argparse
import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from _matrix import collect
from hidden import OMEGA, PHI
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import Discovery, discover
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.observables import COLUMNS
from sandbot_model.physics.walking import Inputs, KCurve, Walker
from sandbot_record.trials.table import Row, Trials, from_rows

SEEDS, QUICK_SEEDS, REPLICATES, MAX_EFFECTS = 6, 1, 3, 2
OUT = Path("runs/variants.jsonl")
GROUND = KCurve(np.array([0.58, 0.6, 0.633]), np.array([170.0, 205.0, 220.0]))
DELTA_T_S = 0.4
NOISE = np.array([0.005, 0.0004, 0.006, 0.001])
"""Scatter of a trial: speed, lift, peak speed, first step [SI]."""
PHI_SD = 6e-4
ALIKE = frozenset({"leg_slip", "cable_drag", "bed_slope"})
"""Told apart by how they vary with depth alone: of these one may stand for another in a set."""
_CRATER = "maximum(z - 0.01*({left})*clip((1.2*R - a)/(0.1*R), 0, 1)*(1 - first), 0)"
_SLIDE = "s += {slide}"
_SLIDES = {
    "u": "omega*maximum(d + h - R, 0)",
    "t": "maximum(pi/omega - 2*arcsin(clip(s_0/(2*R), 0, 1))/omega, 0)/(1 + first)",
}


@dataclass(frozen=True)
class Form:
    """A formula in the place of a family's own, its numbers put in."""

    family: str
    name: str
    stage: str
    text: str
    known: bool = False


FORMS = (
    Form("disturbed_ground", "no ramp", "strength", "k - maximum(k - 175, 0)*where(a < 0.95*R, 1, 0)*(1 - first)"),
    Form("disturbed_ground", "a ramp of 0.3 R", "strength",
         "k - maximum(k - 175, 0)*clip((0.95*R - a)/(0.3*R), 0, 1)*(1 - first)", known=True),
    Form("disturbed_ground", "a smooth ramp", "strength",
         "k - maximum(k - 175, 0)/(1 + exp((a - 0.9*R)/(0.04*R)))*(1 - first)"),
    Form("disturbed_ground", "a share of k", "strength", "k - 0.15*k*clip((0.95*R - a)/(0.1*R), 0, 1)*(1 - first)"),
    Form("stance_overlap", "the first step spared", "speed", "kept *= 1 - 0.1*(1 - first)", known=True),
    Form("stance_overlap", "half in the first step", "speed", "kept *= 1 - 0.1*(1 - 0.5*first)"),
    Form("stance_overlap", "more where fast", "speed", "kept *= 1 - 0.1*(omega/16)**0.5"),
    Form("swimming_thrust", "by the square of ω", "speed", "v_swim = minimum(0.45*16/omega**2, R*omega/pi)"),
    Form("swimming_thrust", "by the root of ω", "speed", "v_swim = minimum(0.45/(omega*16)**0.5, R*omega/pi)"),
    Form("crater_refill", "refills evenly", "strength",
         f"z = {_CRATER.format(left='maximum(1 - pi/(omega*0.4), 0)')}"),
    Form("crater_refill", "refills as a power", "strength", f"z = {_CRATER.format(left='1/(1 + pi/(omega*0.15))')}"),
    Form("crater_refill", "a ramp of 0.3 R", "strength",
         "z = maximum(z - 0.01*exp(-pi/(omega*0.15))*clip((1.2*R - a)/(0.3*R), 0, 1)*(1 - first), 0)", known=True),
    Form("phi_dependent_response", "exponential in φ", "clock", "delta_t *= exp(0.6*(phi - 0.61)/0.05)", known=True),
    Form("phi_dependent_response", "by the square of φ", "clock", "delta_t *= 0.7 + 0.6*((phi - 0.58)/0.053)**2"),
    Form("phi_dependent_response", "in a step", "clock", "delta_t *= 1 + 0.3*tanh((phi - 0.605)/0.01)"),
    Form("belly_coast", "the first step as any other", "step",
         "s += {u}*minimum({u}/(0.7*g), 2*{t}/(2 - first)) - 0.35*g*minimum({u}/(0.7*g), 2*{t}/(2 - first))**2"),
    Form("belly_coast", "viscous", "step", "s += {u}*0.02*(1 - exp(-{t}/0.02))"),
    Form("motor_saturation", "a sharper bend", "clock", "omega = omega/(1 + (omega/40)**4)**0.25", known=True),
    Form("motor_saturation", "a softer bend", "clock", "omega = omega/(1 + omega/200)"),
    Form("motor_saturation", "by the square of ω", "clock", "omega = omega*(1 - (omega/80)**2)"),
    Form("carried_momentum", "by the square of speed", "balance",
         "delta_v = maximum(delta_v - 0.5*v*v/0.15*(1 - first), 0)"),
    Form("carried_momentum", "of the legs' own speed", "balance", "delta_v = delta_v*(1 - 0.2*(1 - first))"),
    Form("inertial_drag", "in proportion to speed cubed", "balance",
         "extra_force += 2*600*w*R*(R*omega)**3/(R*16)", known=True),
    Form("inertial_drag", "to the power 2.5", "balance", "extra_force += 2*600*w*R*(R*omega)**2.5/(R*16)**0.5"),
    Form("inertial_drag", "deeper is more", "balance", "extra_force += 2*600*w*R*(R*omega)**2*2*d/R"),
    Form("leg_slip", "by the inverse of depth", "speed", "s, peak *= clip(1 - 0.1*d_r/maximum(d, 1e-6), 0, 1)",
         known=True),
    Form("leg_slip", "exponential in depth", "speed", "s, peak *= 1 - 0.5*exp(-1.5*d/d_r)"),
    Form("cable_drag", "by the power 1.5 of depth", "speed",
         "s, peak *= clip(1 - 0.3/maximum(1.5*146e3*w*d_r**0.5*d**1.5, 1e-6), 0, 1)"),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One campaign to analyse."""

    family: str
    form: str
    seed: int


def cases(seeds: int, only: Sequence[str] = ()) -> list[Case]:
    """Seed by seed, so that a run stopped early has something of every form."""
    return [
        Case(form.family, form.name, seed) for seed in range(seeds) for form in FORMS if not only or form.family in only
    ]


def drawn(form: Form, seed: int) -> Trials:
    """A campaign of 7 φ × 7 ω × 3 in a world in which the form acts."""
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(PHI, OMEGA, np.arange(REPLICATES), indexing="ij")
    phi, omega, replicate = (axis.ravel().astype(float) for axis in grid)
    phi = phi + rng.normal(0.0, PHI_SD, phi.shape)
    text = form.text.format(**_SLIDES) if form.family == "belly_coast" else form.text
    walker = Walker((formula_effect(f"hidden: {form.stage}: {text}"),))
    inputs = Inputs(GROUND(phi), omega, DELTA_T_S, phi, k_of_phi=GROUND)
    seen = walker.predict(inputs, [{}]).observables
    seen = seen + NOISE * rng.normal(size=seen.shape)
    return from_rows(
        [
            Row(
                trial_id=f"t{i}",
                phi=float(phi[i]),
                omega_rad_s=float(omega[i]),
                gait="UNIFORM",
                replicate=float(replicate[i]),
                **dict(zip(COLUMNS, map(float, seen[i]), strict=True)),
            )
            for i in range(len(phi))
        ]
    )


def analyse(case: Case) -> dict[str, Any]:
    """What the analysis says of one campaign, and how that is to be judged."""
    form = next(one for one in FORMS if (one.family, one.name) == (case.family, case.form))
    found = discover(cells_of(drawn(form, 2000 + case.seed)), catalogue(), max_effects=MAX_EFFECTS)
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
    """A row for each form, and one for all, in Markdown."""
    lines = ["| family | form | campaigns | " + " | ".join(OUTCOMES) + " |", "|" + "---|" * (3 + len(OUTCOMES))]
    for form in FORMS:
        some = [one for one in results if (one["family"], one["form"]) == (form.family, form.name)]
        if some:
            lines.append(_row(form.family, form.name + (" (known)" if form.known else ""), some))
    return "\n".join([*lines, _row("all", "", results)]) + "\n"


def _row(family: str, form: str, some: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(one["outcome"] for one in some)
    return f"| {family} | {form} | {len(some)} | {' | '.join(str(counts[one]) for one in OUTCOMES)} |"


def document(results: Sequence[Mapping[str, Any]]) -> str:
    """The whole report, in Markdown."""
    counts = Counter(one["outcome"] for one in results)
    named = counts["identified"] + counts["partial"] + counts["ambiguous"]
    return "\n".join(
        [
            "# Effects whose formulas have another form",
            "",
            f"{len(results)} campaigns of {len(PHI)} φ × {len(OMEGA)} ω × {REPLICATES}, drawn from the project's own "
            f"chain with a formula in the place of a catalogue's effect; up to {MAX_EFFECTS} effects. `known`: a form "
            "that the catalogue's variants have. `half`: the family, and another beside it. leg_slip, cable_drag and "
            "bed_slope count as one family.",
            "",
            f"* the right family named, partial or in the set: {named} of {len(results)} ({named / len(results):.0%}; "
            "asked ≥ 90 %)",
            f"* another family: {counts['false claim']} ({counts['false claim'] / len(results):.0%}; asked ≤ 2 %), "
            f"another beside the right one: {counts['half']}",
            "",
            report(results),
        ]
    )


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
