"""How many trials, and how many minutes in the lab, until the right verdict, for ways to choose trials.

python benchmarks/trials_to_verdict.py [--seeds 10] [--only STRATEGY] [--week] [--out FILE]    resumes where it stopped

AutoRA's sampler is among the strategies where it is installed: pip install --no-deps -r benchmarks/autora.txt
"""

import argparse
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import hidden
from _figures import Figure, share
from _matrix import collect
from hidden import OMEGA, PHI
from sandbot_lab.direct import ReadingErrors, direct_trial
from sandbot_lab.week import Occasion, Week, batch_seed
from sandbot_lab.world import World
from sandbot_model.data.conditions import Cells, cells_of
from sandbot_model.design.discrepancy import something_else
from sandbot_model.design.look import ALPHA, BLOCK, Look, Plan, look
from sandbot_model.design.places import Places, scatter_of_one
from sandbot_model.design.start import Condition, start
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.verdict import NAMES_EFFECTS
from sandbot_model.physics.catalogue import catalogue
from sandbot_record.trials.table import Row, from_rows

SEEDS, MAX_EFFECTS, EVERY = 10, 2, 5
OUT = Path(__file__).with_name("trials_to_verdict.jsonl")
"""Kept beside the report: all of it takes hours, and whoever comes next goes on from there."""
REPLICATES, FIRST_REPLICATES = 3, 2
WEEK = Week(k_batch_sd=0.005, k_drift=0.01, lift_zero_m=0.0003, speed_scale=0.003)
"""A real week, mild: every block another offset of k, a drift, a lift zero, a speed scale."""
CONDITIONS: list[Condition] = [(phi, omega) for phi in PHI for omega in OMEGA]
BUDGET = REPLICATES * len(CONDITIONS)
BY_NAME = {world.name: world for world in (*hidden.WORLDS, hidden.NULL)}
WORLDS: Mapping[str, float] = {
    "null": 1.0,
    "disturbed_ground(k_l_n_per_m=175, s_c=0.95)": 1.0,
    "exact_vertical_acceleration()": 1.0,
    "stance_overlap(eta=0.1)": 1.0,
    "swimming_thrust(a_m_s2=0.32)": 1.0,
    "crater_refill(z0_m=0.006, tau_s=0.1)": 1.0,
    "phi_dependent_response(b=0.6)": 1.0,
    "belly_coast(mu_b=0.4)": 1.0,
    "motor_saturation(omega_s_rad_s=90)": 1.0,
    "carried_momentum(chi_m=0.3)": 1.0,
    "inertial_drag(lambda_=1)": 1.0,
    "leg_slip(sigma=0.1)": 1.0,
    "disturbed_ground + stance_overlap": 1.0,
    "exact_vertical_acceleration + stance_overlap": 1.0,
    "crater_refill + stance_overlap": 1.0,
    "stance_overlap + swimming_thrust": 1.0,
    "x_foot_clogging(loss=0.3, omega_0_rad_s=15, width_rad_s=4)": 1.0,
    "x_resonance(loss=0.3, omega_0_rad_s=12, width_rad_s=2)": 1.0,
    "x_traction_loss(loss=0.4)": 1.0,
    "x_belly_suction(force_n=1.5)": 1.0,
    "dilation(xi=0.7, phi_c=0.6, s_c=0.95)": 1.0,
}
"""Null, single effects, one class of effects that are alike, pairs, outside the catalogue, and near the switch."""
ALIKE = frozenset({"leg_slip"})


@dataclass
class Campaign:
    """A campaign under way in a world: its rows so far."""

    world: World
    gait: str
    seed: int
    rows: list[Row] = field(default_factory=list)
    seconds: float = 0.0
    blocks: int = 0
    done: dict[Condition, int] = field(default_factory=dict)

    def run(self, block: Sequence[Condition]) -> None:
        """One block of trials, one after the other."""
        self.blocks += 1
        batch = f"block{self.blocks}"
        for condition in block:
            replicate = self.done[condition] = self.done.get(condition, -1) + 1
            when = len(self.rows)
            occasion = Occasion(batch_seed(self.seed, batch), 0, when / (BUDGET - 1))
            row = direct_trial(self.world, *condition, self.gait, replicate, self.seed, occasion, ReadingErrors())
            self.rows.append(Row(**{**row, "batch": batch, "run_order": when + 1}))
            self.seconds += cost_s(condition)

    def grid(self, replicates: int, every: int = 1) -> None:
        """The grid, or every other row and column of it, in random blocks."""
        some = [(phi, omega) for phi in PHI[::every] for omega in OMEGA[::every]]
        for number in range(replicates):
            order = np.random.default_rng([self.seed, number]).permutation(len(some))
            self.run([some[index] for index in order])

    @property
    def cells(self) -> Cells:
        """What a look sees."""
        return cells_of(from_rows(self.rows))


def cost_s(condition: Condition) -> float:
    """Seconds a trial takes: the bed's preparation, as long as the virtual lab's, and the run."""
    phi, omega = condition
    pulses = 22 * -math.log(1 - min((phi - 0.58) / 0.053, 0.98))
    return 12.0 + 1.1 * pulses + 0.25 + max(1.2, 8 * math.pi / omega)


Choose = Callable[[Campaign, Look], Sequence[Condition]]


def chosen(_campaign: Campaign, seen: Look) -> Sequence[Condition]:
    """Ours: the trials that decide."""
    return [(one.phi, one.omega_rad_s) for one in seen.block]


def at_random(campaign: Campaign, _seen: Look) -> Sequence[Condition]:
    """Anywhere on the grid."""
    draw = np.random.default_rng([campaign.seed, campaign.blocks, 7])
    return [CONDITIONS[index] for index in draw.integers(len(CONDITIONS), size=BLOCK)]


def space_filling(campaign: Campaign, _seen: Look) -> Sequence[Condition]:
    """Where there have been fewest trials, farthest from the others first."""
    count = {one: campaign.done.get(one, -1) for one in CONDITIONS}
    picked: list[Condition] = []
    for _ in range(BLOCK):
        least = min(count.values())
        there = np.array([one for one in CONDITIONS if count[one] > least] or CONDITIONS[:1])
        free = [one for one in CONDITIONS if count[one] == least]
        away = [float(np.min(np.hypot((p - there[:, 0]) / 0.053, (w - there[:, 1]) / 26.0))) for p, w in free]
        picked.append(free[int(np.argmax(away))])
        count[picked[-1]] += 1
    return picked


def least_known(_campaign: Campaign, seen: Look) -> Sequence[Condition]:
    """Where a Gaussian process, with no idea of what may be missing, knows least for what it costs."""
    base = seen.found.steps[0]
    spread = something_else(base, Places.of(CONDITIONS, base), DEFAULT.gross)
    variance = np.einsum("pipi->p", spread.common) / [cost_s(one) for one in CONDITIONS]
    return [CONDITIONS[index] for index in np.argsort(-variance)[:BLOCK]]


def where_it_errs(campaign: Campaign, seen: Look) -> Sequence[Condition]:
    """AutoRA's falsification sampler: a network learns the leading fit's errors and says where they will be largest."""
    torch = import_module("torch")
    sampler = import_module("autora.experimentalist.falsification").falsification_score_sample_from_predictions
    torch.manual_seed(campaign.seed + campaign.blocks)
    torch.set_num_threads(1)  # the other cores have campaigns of their own
    fit = seen.found.fit
    sigma = scatter_of_one(fit.cells)
    predicted = fit.predicted / sigma
    # What was not measured is no error.
    measured = np.where(np.isfinite(fit.cells.mean), fit.cells.mean / sigma, predicted)
    least, span = np.min(CONDITIONS, axis=0), np.ptp(CONDITIONS, axis=0)
    tried = (np.stack([fit.level_phi[fit.cells.level], fit.cells.omega], axis=-1) - least) / span
    asked, _ = sampler((CONDITIONS - least) / span, predicted, tried, measured, num_samples=BLOCK)
    return [min(CONDITIONS, key=lambda one: float(np.hypot(*((one - least) / span - at)))) for at in asked]


AUTORA = "AutoRA falsification"
SEQUENTIAL: Mapping[str, Choose] = {
    "until verdict": chosen,
    "random": at_random,
    "space-filling": space_filling,
    "Gaussian process only": least_known,
    AUTORA: where_it_errs,
}
"""All from the same start, with the same rule to stop."""
FIXED: Mapping[str, tuple[int, int]] = {"grid 7 x 7 x 3": (3, 1), "grid 7 x 7 x 2": (2, 1), "grid 4 x 4 x 3": (3, 2)}
ROUNDS = "grid 4 x 4 x 2 and --plan rounds"
STRATEGIES = (*SEQUENTIAL, *FIXED, ROUNDS)
HERE = [name for name in STRATEGIES if name != AUTORA or find_spec("autora")]
"""What can be run: AutoRA wants torch, which no other part of the project does."""


@dataclass(frozen=True)
class Case:
    """One campaign."""

    strategy: str
    world: str
    seed: int
    week: bool = False


def analyse(case: Case) -> dict[str, Any]:
    """What became of it."""
    from_hidden = BY_NAME[case.world]
    world = from_hidden.world(WORLDS[case.world])
    world = dataclasses.replace(world, week=WEEK) if case.week else world
    campaign = Campaign(world, from_hidden.gait, 5000 + case.seed)
    if case.strategy in FIXED:
        campaign.grid(*FIXED[case.strategy])
        verdict = discover(campaign.cells, catalogue(), max_effects=MAX_EFFECTS).verdict
    elif case.strategy == ROUNDS:
        verdict = _in_rounds(campaign)
    else:
        verdict = _until_verdict(campaign, SEQUENTIAL[case.strategy])
    named = [frozenset(one) for one in verdict.alternatives] or [frozenset(verdict.effects)]
    return {
        **dataclasses.asdict(case),
        "outcome": outcome(from_hidden, verdict.status, named),
        "status": verdict.status,
        "trials": len(campaign.rows),
        "minutes": campaign.seconds / 60,
    }


def _until_verdict(campaign: Campaign, choose: Choose) -> Any:
    for _ in range(FIRST_REPLICATES):
        campaign.run(start(PHI, OMEGA))
    plan, number = Plan(CONDITIONS, cost_s, REPLICATES), 0
    while True:
        number += 1
        seen = look(campaign.cells, catalogue(), plan, number=number, max_effects=MAX_EFFECTS)
        if seen.stop or len(campaign.rows) >= BUDGET:
            return seen.found.verdict
        campaign.run(choose(campaign, seen))


def _in_rounds(campaign: Campaign) -> Any:
    """As one would do by hand: discover, its next trials, discover again, until it asks for none."""
    campaign.grid(2, 2)
    while True:
        found = discover(campaign.cells, catalogue(), max_effects=MAX_EFFECTS)
        asked = [(one.phi, one.omega_rad_s) for one in found.next_trials if math.isfinite(one.omega_rad_s)]
        near = [min(CONDITIONS, key=lambda one: abs(one[0] - p) * 500 + abs(one[1] - w)) for p, w in asked]
        if not near or len(campaign.rows) >= BUDGET:
            return found.verdict
        campaign.run([one for one in near for _ in range(FIRST_REPLICATES)])


def outcome(world: hidden.Hidden, status: str, named: Sequence[frozenset[str]]) -> str:
    """right, false claim, or undecided; a set that holds the truth is right where no observable tells its members."""
    truth = frozenset(world.truth)
    claims = status in NAMES_EFFECTS
    if world.kind == "outside":
        return "false claim" if status == "identified" else "right"
    if not truth:
        return "right" if status == "adequate" else "false claim" if claims else "undecided"
    if claims and truth not in named:
        # Of a pair one alone, as part of it: not all, but not wrong.
        return "undecided" if any(one < truth and one for one in named) else "false claim"
    return "right" if status == "identified" or (claims and truth & ALIKE) else "undecided"


def report(results: Sequence[Mapping[str, Any]]) -> str:
    """A row for each strategy, in Markdown."""
    head = "| strategy | campaigns | right | false claim | undecided | trials, median (mean) | lab min, median |"
    lines = [head, "|" + "---|" * 7]
    for name in STRATEGIES:
        some = [one for one in results if one["strategy"] == name]
        if some:
            shares = [sum(one["outcome"] == what for one in some) for what in ("right", "false claim", "undecided")]
            trials = [one["trials"] for one in some]
            lines.append(
                f"| {name} | {len(some)} | {' | '.join(f'{n} ({n / len(some):.0%})' for n in shares)} | "
                f"{median(trials):.0f} ({np.mean(trials):.0f}) | {median(one['minutes'] for one in some):.0f} |"
            )
    return "\n".join(lines) + "\n"


def by_world(results: Sequence[Mapping[str, Any]], strategy: str) -> str:
    """A row for each world of one strategy."""
    lines = ["| world | right | false claim | undecided | trials, median | least–most |", "|" + "---|" * 6]
    for name in WORLDS:
        some = [one for one in results if one["strategy"] == strategy and one["world"] == name]
        if some:
            counts = [sum(one["outcome"] == what for one in some) for what in ("right", "false claim", "undecided")]
            trials = [one["trials"] for one in some]
            row = [name, *map(str, counts), f"{median(trials):.0f}", f"{min(trials)}–{max(trials)}"]
            lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines) + "\n"


def cases(seeds: int, only: Sequence[str] = (), week: bool = False) -> list[Case]:
    """Seed by seed, so that a run stopped early has something of every world."""
    names = only or HERE
    return [Case(name, world, seed, week) for seed in range(seeds) for world in WORLDS for name in names]


def document(results: Sequence[Mapping[str, Any]]) -> str:
    """The whole report, in Markdown."""
    clean = [one for one in results if not one["week"]]
    week = [one for one in results if one["week"]]
    parts = [
        "# Trials to the right verdict",
        "",
        f"{len(WORLDS)} worlds of the virtual lab, read directly, φ × ω = {len(PHI)} × {len(OMEGA)}; up to "
        f"{MAX_EFFECTS} effects; α = {ALPHA}. Strategies are shown over the campaigns that were run, which may differ.",
        "",
        report(clean),
        "`campaign --until verdict`, world by world:",
        "",
        by_world(clean, "until verdict"),
    ]
    if week:
        parts += [
            "With the nuisances of a mild week (offsets of k from block to block, drift, lift zero, speed scale):"
        ]
        parts += ["", report(week), by_world(week, "until verdict")]
    return "\n".join(parts)


def sample() -> list[Figure]:
    """Ours in every so many worlds."""
    with ProcessPoolExecutor() as pool:
        results = list(pool.map(analyse, cases(1, ("until verdict",))[::EVERY]))
    trials = float(median(one["trials"] for one in results))
    right = [one["outcome"] == "right" for one in results]
    return [
        Figure(
            "trials to a verdict, of 147 in the whole grid",
            f"median of {len(results)} campaigns",
            trials,
            "≤ 74 trials",
        ),
        *share("verdicts right if the campaign stops by itself", "campaigns", right, "≥ 95 %"),
    ]


def main() -> str:
    """Ours and the grids, once in each world: what `make bench` has time for."""
    return document(collect(analyse, cases(1, ("until verdict", *FIXED)), OUT))


def command() -> None:
    """Run what is missing of a part and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--only", action="append", default=[], choices=HERE)
    parser.add_argument("--week", action="store_true")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--workers", type=int)
    args = parser.parse_args()
    print(document(collect(analyse, cases(args.seeds, args.only, args.week), args.out, args.workers)))


if __name__ == "__main__":
    command()
