"""Verdicts of campaigns nobody planned for: design, ground, noise, gait, what was measured, the week: all at random.

python benchmarks/designs.py [--campaigns 400] [--first 0] [--out runs/designs.jsonl] [--workers N]    resumes

The other matrices ask much of one design, 7 φ × 7 ω × 3; this one asks a little of hundreds. What is found here is a
fault more often than a rate: a crash, a fit that stays in a valley, a claim that stands on a value nobody believes.
"""

import argparse
import dataclasses
import math
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from _figures import Figure, share
from _matrix import Matrix, collect
from hidden import NULL, WORLDS, Hidden
from nuisance import DRAWN, NUISANCES, ORDERS, drawn
from sandbot_lab.direct import direct_trials
from sandbot_lab.week import Week
from sandbot_lab.world import Noise, World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.verdict import NAMES_EFFECTS
from sandbot_model.physics.catalogue import catalogue
from sandbot_record.trials.table import Row, Trials, from_rows
from variants import ALIKE

CAMPAIGNS, SAMPLE, MAX_EFFECTS = 400, 30, 2
OUT = Path("runs/designs.jsonl")
NULLS, WEEKS = 0.3, 0.5
"""Shares of campaigns in which nothing is hidden, and that are run in a week drawn from its priors."""
PHI, OMEGA = (0.575, 0.635), (3.0, 32.0)
NARROWEST = 0.02
"""Of the volume fractions of a campaign; one that is narrower has those of the others."""
MEASURED: Mapping[str, tuple[str, ...]] = {
    "all four": (),
    "no first step": ("first_step_m",),
    "speed and lift": ("first_step_m", "peak_speed_m_s"),
    "speed alone": ("first_step_m", "peak_speed_m_s", "lift_m"),
}
GAITS, REPLICATES, LN_NOISE = ("UNIFORM", "UNIFORM", "SGCS"), (1, 2, 2, 3, 3, 4, 6), (-0.7, 1.0)
"""Drawn from with equal odds; noise as the logarithm of its scale."""
CLOCK = "slow_phase_speed"
"""What the lab has by itself in gaits whose slow phase is slower than their clock."""
KINDS = {
    "null": "nothing",
    "separable": "an effect",
    "alike": "an effect",
    "faint": "an effect hardly seen",
    "pair": "two effects",
    "outside": "none of the catalogue",
}
OUTCOMES = ("named", "in part", "adequate", "unexplained", "untested", "false claim", "crash")


@dataclass(frozen=True)
class Case:
    """One campaign, by its number, and what was measured of it."""

    number: int
    measured: str


@dataclass(frozen=True)
class Campaign:
    """What the lab hides and what it measures."""

    hidden: Hidden
    world: World
    phi: Sequence[float]
    omega: Sequence[float]
    gait: str
    replicates: int
    batches: str
    order: str | None

    @property
    def truth(self) -> frozenset[str]:
        """Effects that act."""
        return frozenset(self.hidden.truth) | ({CLOCK} if self.gait != "UNIFORM" else frozenset())


def campaign(case: Case) -> Campaign:
    """What one number stands for."""
    draw = np.random.default_rng([case.number, 0xDE51])
    hidden = NULL if draw.random() < NULLS else WORLDS[draw.integers(len(WORLDS))]
    in_a_week = draw.random() < WEEKS
    orders = ORDERS if in_a_week else (None, *ORDERS)
    return Campaign(
        hidden,
        world_of(hidden, draw, drawn(case.number) if in_a_week else Week()),
        phi=_levels(draw),
        omega=np.sort(draw.uniform(*OMEGA, draw.integers(3, 9))).round(1).tolist(),
        gait=str(draw.choice(GAITS)) if hidden.gait == "UNIFORM" else hidden.gait,
        replicates=int(draw.choice(REPLICATES)),
        batches=NUISANCES[str(draw.choice(DRAWN))][0] if in_a_week else "none",
        order=orders[draw.integers(len(orders))],
    )


def world_of(hidden: Hidden, draw: np.random.Generator, week: Week) -> World:
    """The lab's world on a ground, and with a noise, of its own; a world that says its ground keeps it."""
    knots = np.sort(draw.uniform(150.0, 260.0, 3)) + np.array([0.0, 5.0, 10.0])
    ground = {"k_knots_n_per_m": tuple(knots.tolist()), "delta_t_s": float(draw.uniform(0.2, 0.6)), **hidden.lab}
    noise, swim = math.exp(draw.uniform(*LN_NOISE)), float(draw.uniform(0.005, 0.04))
    effects = {name: dict(values) for name, values in hidden.effects.items()}
    return World(effects=effects, noise=Noise(scale=noise), swim_m_s=swim, week=week, **ground)


def _levels(draw: np.random.Generator) -> list[float]:
    low, high = np.sort(draw.uniform(*PHI, 2))
    ends = (low, high) if high - low > NARROWEST else PHI
    return np.linspace(*ends, draw.integers(3, 10)).round(4).tolist()


def trials(case: Case) -> Trials:
    """What the lab measures, without what this campaign did not."""
    run = campaign(case)
    rows = direct_trials(
        run.world, run.phi, run.omega, run.gait, run.replicates, case.number, None, run.order, run.batches
    )
    lost = dict.fromkeys(MEASURED[case.measured], math.nan)
    return from_rows([Row(**{**row, **lost}) for row in rows])


def analyse(case: Case) -> dict[str, Any]:
    """What is said of one campaign, and how that is to be judged."""
    run = campaign(case)
    about = {
        **dataclasses.asdict(case),
        "hidden": run.hidden.name,
        "kind": run.hidden.kind,
        "gait": run.gait,
        "design": f"{len(run.phi)} x {len(run.omega)} x {run.replicates}",
        "week": run.batches != "none",
    }
    try:
        found = discover(cells_of(trials(case)), catalogue(), max_effects=MAX_EFFECTS)
    except Exception:
        return {**about, "outcome": "crash", "said": traceback.format_exc(limit=-2)}
    return {**about, "outcome": outcome(run.truth, found), "said": found.headline, "because": found.verdict.because}


def outcome(truth: frozenset[str], found: Discovery) -> str:
    """A column of the table. What names effects, none of whose alternatives is part of the truth, is a false claim."""
    verdict = found.verdict
    if verdict.status not in NAMES_EFFECTS:
        return verdict.status
    acting = _family(truth)
    named = [_family(one) for one in verdict.alternatives or (verdict.effects,)]
    if acting in named:
        return "named"
    return "in part" if any(one < acting for one in named) else "false claim"


def _family(effects: Iterable[str]) -> frozenset[str]:
    """Effects that nothing but depth tells apart count as one."""
    return frozenset("alike" if name in ALIKE else name for name in effects)


def document(results: Sequence[Mapping[str, Any]]) -> str:
    """The whole report, in Markdown."""
    return "\n".join(
        [
            "# Campaigns nobody planned for",
            "",
            f"{len(results)} campaigns of 3 to 9 φ × 3 to 8 ω × 1 to 6 trials; φ, ω, ground, Δt, noise (half to three "
            f"times the usual), gait and what was measured are drawn at random, and in {WEEKS:.0%} a week from its "
            f"priors. Hidden: nothing in {NULLS:.0%}, else a world of hidden.py. In a gait with a slow phase the lab's "
            f"legs have a {CLOCK} of their own. `in part`: part of the truth and nothing else. `false claim`: what is "
            "named is in no alternative part of the truth; of a world outside the catalogue, anything. Many a design "
            "tells little, so the shares are of this mixture alone.",
            "",
            *_table("hidden", results, lambda one: KINDS[one["kind"]]),
            "",
            *_table("measured", results, lambda one: one["measured"]),
            "",
            *_table("gait", results, lambda one: one["gait"]),
            "",
            *_false(results),
        ]
    )


def _table(what: str, results: Sequence[Mapping[str, Any]], of: Callable[[Mapping[str, Any]], str]) -> list[str]:
    lines = [f"| {what} | campaigns | " + " | ".join(OUTCOMES) + " |", "|" + "---|" * (2 + len(OUTCOMES))]
    for key in sorted({of(one) for one in results}):
        counts = Counter(one["outcome"] for one in results if of(one) == key)
        lines.append(f"| {key} | {counts.total()} | {' | '.join(str(counts[one]) for one in OUTCOMES)} |")
    return lines


def _false(results: Sequence[Mapping[str, Any]]) -> list[str]:
    return [
        f"* {one['outcome']}, number {one['number']}: {one['hidden']}, {one['gait']}, {one['design']}, "
        f"{one['measured']}{', a week' if one['week'] else ''}: {one['said']}"
        for one in results
        if one["outcome"] in ("false claim", "crash")
    ]


def cases(campaigns: int, first: int = 0) -> list[Case]:
    """Each kind of what is measured in turn."""
    names = list(MEASURED)
    return [Case(number, names[number % len(names)]) for number in range(first, first + campaigns)]


def _figures_of(results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    nothing = [one["outcome"] == "false claim" for one in results if one["kind"] == "null"]
    false = [one["outcome"] == "false claim" for one in results if one["kind"] not in ("null", "outside")]
    return [
        *share("any design: claims where nothing is hidden", "campaigns", nothing, "≤ 2 %"),
        *share("any design: an effect named that is not hidden", "campaigns", false, "≤ 2 %"),
        *share(
            "any design: ends without a crash", "campaigns", [one["outcome"] != "crash" for one in results], "≥ 100 %"
        ),
    ]


_matrix = Matrix(analyse, lambda: cases(SAMPLE), lambda: cases(CAMPAIGNS), OUT, document, _figures_of)
sample, main, figures = _matrix.sample, _matrix.main, _matrix.figures


def command() -> None:
    """Run what is missing and print the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=CAMPAIGNS)
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--workers", type=int)
    args = parser.parse_args()
    print(document(collect(analyse, cases(args.campaigns, args.first), args.out, args.workers)))


if __name__ == "__main__":
    command()
