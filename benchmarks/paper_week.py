"""Verdicts and errors in the paper's own world, under what a real week in a lab does.

python benchmarks/paper_week.py [--seeds 4] [--only NAME] [--out runs/paper_week.jsonl] [--workers N]    resumes

The nuisances are those of nuisance.py, in the order that campaigns have by default. In this world steps are cut short
and the last step disturbs the ground: Δt shows in little but which conditions walk.
"""

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nuisance
from _figures import Figure, share
from _matrix import Matrix, collect, options
from sandbot_bringup.config import config_folder
from sandbot_common.robot import read_robot
from sandbot_lab.direct import direct_trials
from sandbot_lab.world import World, read_world
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.walking import BASES
from sandbot_record.trials.table import Row, from_rows

SEEDS, QUICK_SEEDS, EVERY = 4, 1, 9
OUT = Path("runs/paper_week.jsonl")
PHI = (0.580, 0.590, 0.600, 0.611, 0.616, 0.622, 0.633)
OMEGA = (4, 8, 12, 16, 20, 24, 30)
THREE = "the paper's three"
"""The world as it is, searched from the simple model, which has none of them."""
EXTRA: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "nothing": {},
    THREE: {},
    "swimming_thrust": {"swimming_thrust": {"a_m_s2": 0.45}},
    "phi_dependent_response": {"phi_dependent_response": {"b": -0.5}},
    "crater_refill": {"crater_refill": {"z0_m": 0.005}},
}
"""What is hidden beside the paper's three effects, which the model of the search has already but in one row."""
TRUE = {
    "delta_t_s": 0.18,
    "disturbed_ground.k_l_n_per_m": 182.0,
    "belly_coast.mu_b": 0.35,
    "slow_phase_speed.rho": 0.389,
}
"""What of li09_world.yaml a fit has; ρ is the gait's β."""
STATUSES = ("named", "adequate", "partial", "ambiguous", "unexplained", "untested", "false claim")


@dataclass(frozen=True)
class Case:
    """One campaign to analyse."""

    nuisance: str
    dose: str
    hidden: str
    seed: int

    @property
    def world(self) -> World:
        """The paper's, with what is hidden beside it and the week that nuisance.py has for it."""
        week = nuisance.Case(self.nuisance, self.dose, "randomised", "null", self.seed).world.week
        paper = read_world(config_folder() / "li09_world.yaml")
        return dataclasses.replace(paper, effects={**paper.effects, **EXTRA[self.hidden]}, week=week)

    @property
    def truth(self) -> frozenset[str]:
        """What is to be named."""
        return frozenset(BASES["li09"] if self.hidden == THREE else EXTRA[self.hidden])


def cases(seeds: int, only: Sequence[str] = ()) -> Iterator[Case]:
    """Seed by seed: in each row nothing, one effect in turn, and the paper's three."""
    single = [name for name in EXTRA if EXTRA[name]]
    rows = [
        (name, dose) for name in nuisance.NUISANCES for dose in nuisance.DOSES if (name, dose) != ("clean", "strong")
    ]
    for seed in range(seeds):
        for at, row in enumerate(rows):
            for hidden in ("nothing", single[(seed + at) % len(single)], THREE):
                if not only or row[0] in only or hidden in only:
                    yield Case(*row, hidden, seed)


def analyse(case: Case) -> dict[str, Any]:
    """The outcome of one case, and how many standard errors each parameter is off the truth where that is named."""
    robot = read_robot(config_folder() / "sgcs_robot.yaml")
    world, batches = case.world.walked_by(robot), nuisance.NUISANCES[case.nuisance][0]
    rows = direct_trials(world, PHI, OMEGA, "SGCS", 3, 1000 + case.seed, None, "randomised", batches)
    base = "simple" if case.hidden == THREE else "li09"
    found = discover(cells_of(from_rows([Row(**row) for row in rows], robot)), catalogue(), base=base)
    said = nuisance.outcome(case.truth, found.verdict)
    right = said in ("named", "adequate") and set(found.verdict.effects) == case.truth
    return {**dataclasses.asdict(case), "outcome": said, "z": nuisance.off_by(found.fit, TRUE, world) if right else {}}


def report(results: Sequence[Mapping[str, Any]]) -> str:
    """A row for each nuisance and dose, in Markdown."""
    head = ["nuisance", "dose", "worlds", "right", *STATUSES, "Δt 1σ/2σ", "k 1σ/2σ", "effects 1σ/2σ"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    rows = dict.fromkeys((one["nuisance"], one["dose"]) for one in sorted(results, key=_place))
    for row in rows:
        lines.append(_line(row, [one for one in results if (one["nuisance"], one["dose"]) == row]))
    return "\n".join([*lines, _line(("all", ""), results)]) + "\n"


def _place(one: Mapping[str, Any]) -> tuple[int, int]:
    return list(nuisance.NUISANCES).index(one["nuisance"]), nuisance.DOSES.index(one["dose"])


def _line(row: tuple[str, str], some: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(one["outcome"] for one in some)
    cells = [*row, len(some), sum(map(_right, some)), *(counts[one] for one in STATUSES)]
    return f"| {' | '.join(map(str, [*cells, *(nuisance.covered(some, kind) for kind in ('delta_t_s', 'k[', '.'))]))} |"


def _right(one: Mapping[str, Any]) -> bool:
    return bool(one["outcome"] == ("adequate" if one["hidden"] == "nothing" else "named"))


def document(results: Sequence[Mapping[str, Any]]) -> str:
    """The whole report, in Markdown."""
    seeds = len({one["seed"] for one in results})
    wrong = "; ".join(
        f"{one['nuisance']}, {one['dose']}, {one['hidden']}, seed {one['seed']}: {one['outcome']}"
        for one in results
        if not _right(one)
    )
    return "\n".join(
        [
            "# The paper's world in a real week",
            "",
            f"{len(results)} campaigns of {len(PHI)} φ × {len(OMEGA)} ω × 3 trials in SGCS, in random order, {seeds} "
            "seed(s); nuisances as in nuisance.md. In li09_world.yaml nothing or one of "
            f"{', '.join(name for name in EXTRA if EXTRA[name])} in turn is hidden, and searched for from the model "
            "li09; or nothing is added, and the search begins with the simple model, which has none of the paper's "
            "three effects. Coverage of right verdicts only.",
            "",
            report(results),
            f"Not right: {wrong or 'none'}.",
        ]
    )


def _figures_of(results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    false = [one["outcome"] == "false claim" for one in results]
    return [
        *share("verdicts right in the paper's world in a real week", "campaigns", list(map(_right, results)), "≥ 95 %"),
        *share("false claims in the paper's world in a real week", "campaigns", false, "≤ 2 %"),
    ]


_matrix = Matrix(analyse, lambda: list(cases(1))[::EVERY], lambda: list(cases(QUICK_SEEDS)), OUT, document, _figures_of)
sample, main, figures = _matrix.sample, _matrix.main, _matrix.figures


def command() -> None:
    """Run what is missing of a part and print its table."""
    args = options(__doc__, SEEDS, OUT, "a nuisance or what is hidden").parse_args()
    print(report(collect(analyse, list(cases(args.seeds, args.only)), args.out, args.workers)))


if __name__ == "__main__":
    command()
