"""Verdicts under what a real week in a lab does: nuisance × dose × run order × truth.

python benchmarks/nuisance.py [--seeds 20] [--only NAME] [--out runs/nuisance.jsonl]    resumes where it was stopped

``--own`` offers nothing but the truth's own effects: coverage, and what is refused, in a tenth of the time. With
``--drawn`` each seed draws its week from the priors that ``discover`` has of one: only over these can an interval that
holds a nuisance cover as often as it says.
"""

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from _figures import Figure, share
from _matrix import Matrix, collect, options
from hidden import CLEAR, OMEGA, PHI, of_other_draws
from sandbot_common.accuracy import Accuracy
from sandbot_lab.direct import direct_trials
from sandbot_lab.week import Week
from sandbot_lab.world import World
from sandbot_model.data.conditions import Cells, cells_of
from sandbot_model.discovery.batch_sd import BatchSd
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.nuisances_about import nuisances_for
from sandbot_model.discovery.verdict import NAMES_EFFECTS
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.global_minimum import solve_near
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.trials.table import Row, from_rows

SEEDS, QUICK_SEEDS, EVERY = 20, 2, 4
"""Seeds of the whole matrix, and those that `make bench` has time for: one takes two cores two minutes."""
OUT = Path("runs/nuisance.jsonl")
GRAIN_M = 1e-3
NUISANCES: Mapping[str, tuple[str, Mapping[str, float], Mapping[str, float]]] = {
    "clean": ("replicate", {}, {}),
    "one omega a day": ("omega", {"k_batch_sd": 0.005}, {"k_batch_sd": 0.015}),
    "one preparation a condition": ("condition", {"k_batch_sd": 0.005}, {"k_batch_sd": 0.01}),
    "blocks on days": ("replicate", {"k_batch_sd": 0.005}, {"k_batch_sd": 0.015}),
    "drift": ("replicate", {"k_drift": 0.01}, {"k_drift": 0.03}),
    "jump": ("replicate", {"k_jump": 0.01}, {"k_jump": 0.03}),
    "lift zero": ("replicate", {"lift_zero_m": 0.3 * GRAIN_M}, {"lift_zero_m": GRAIN_M}),
    "speed scale": ("replicate", {"speed_scale": 0.003}, {"speed_scale": 0.01}),
    "phi zero": ("replicate", {"phi_zero": 0.001}, {"phi_zero": 0.003}),
    "readings set anew each day": (
        "omega",
        {"lift_zero_batch_sd_m": 0.2 * GRAIN_M, "speed_scale_batch_sd": 0.003},
        {"lift_zero_batch_sd_m": 0.6 * GRAIN_M, "speed_scale_batch_sd": 0.01},
    ),
    "readings set anew each block": (
        "replicate",
        {"lift_zero_batch_sd_m": 0.2 * GRAIN_M, "speed_scale_batch_sd": 0.003},
        {"lift_zero_batch_sd_m": 0.6 * GRAIN_M, "speed_scale_batch_sd": 0.01},
    ),
    "a bad week": (
        "omega",
        {"k_batch_sd": 0.005, "k_drift": 0.01, "lift_zero_m": 0.3 * GRAIN_M, "speed_scale": 0.003},
        {"k_batch_sd": 0.01, "k_drift": 0.03, "lift_zero_m": GRAIN_M, "speed_scale": 0.01},
    ),
}
"""What the trials of a batch share, and the world's ``week`` in a mild and a strong dose."""
DRAWN = ("blocks on days", "one omega a day", "one preparation a condition")
"""How batches are made where the week is drawn from its priors."""
SIDED = ("k_drift", "k_jump", "lift_zero_m", "speed_scale", "phi_zero")
"""Of these a dose is the size: one that is the same in every seed would be off by the same in every seed."""
JUMP_AT = (0.1, 0.9)
"""Where in a campaign k may jump."""
DOSES = ("mild", "strong")
FROM_PRIORS = "drawn"
ORDERS = ("as_listed", "randomised")
TRUTHS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "null": {},
    "disturbed_ground": {"disturbed_ground": {"k_l_n_per_m": 175.0, "s_c": 0.95}},
    "exact_vertical_acceleration": {"exact_vertical_acceleration": {}},
    "stance_overlap": {"stance_overlap": {"eta": 0.1}},
    "swimming_thrust": {"swimming_thrust": {"a_m_s2": 0.32}},
    "phi_dependent_response": {"phi_dependent_response": {"b": 0.6}},
}
EFFECTS = tuple(name for name in TRUTHS if TRUTHS[name])
NOMINAL, BANDS = (0.6827, 0.9545), ((0.60, 0.76), (0.90, 0.99))
"""Probabilities within one and two standard errors, and the coverage asked of every row."""
STATUSES = ("adequate", "named", "partial", "ambiguous", "unexplained", "untested", "false claim")


@dataclass(frozen=True)
class Case:
    """One campaign to analyse."""

    nuisance: str
    dose: str
    order: str
    truth: str
    seed: int

    @property
    def world(self) -> World:
        """What the lab hides: of the dose's size, to which side and from when on as the seed has it."""
        if self.dose == FROM_PRIORS:
            return World(effects=TRUTHS[self.truth], week=drawn(self.seed))
        dose = NUISANCES[self.nuisance][1 + DOSES.index(self.dose)]
        rng = np.random.default_rng([self.seed, 0x51DE])
        sides = dict(zip(SIDED, rng.choice([-1.0, 1.0], len(SIDED)), strict=True))
        week = Week(**{key: sides.get(key, 1.0) * value for key, value in dose.items()})
        if week.k_jump:
            week = dataclasses.replace(week, k_jumps_at=(float(rng.uniform(*JUMP_AT)),))
        return World(effects=TRUTHS[self.truth], week=week)


def drawn(seed: int) -> Week:
    """A week as ``discover`` takes weeks to be, drawn from its priors."""
    size, drift, lift_zero, scale = np.random.default_rng([seed, 0xD3A]).standard_normal(4)
    return Week(
        k_batch_sd=DEFAULT.bed_scatter * abs(size),
        k_drift=math.expm1(DEFAULT.drift * drift),
        lift_zero_m=Accuracy().lift_zero_m * lift_zero,
        speed_scale=Accuracy().speed_scale * scale,
    )


def cases(seeds: int, only: Sequence[str] = (), drawn_from_priors: bool = False) -> Iterator[Case]:
    """The matrix, seed by seed, so that a run stopped early has something of every row: in each nothing, and one effect
    in turn."""
    rows = [(kind, FROM_PRIORS, order) for kind in DRAWN for order in ORDERS] if drawn_from_priors else _rows()
    for seed in range(seeds):
        for at, row in enumerate(rows):
            for truth in ("null", EFFECTS[(seed + at) % len(EFFECTS)]):
                if not only or row[0] in only or truth in only:
                    yield Case(*row, truth, seed)


def _rows() -> list[tuple[str, str, str]]:
    """Nuisance, dose and order."""
    return [
        (nuisance, dose, order)
        for nuisance in NUISANCES
        for dose in (DOSES if nuisance != "clean" else DOSES[:1])
        for order in ORDERS
    ]


def analyse(case: Case, own: bool = False) -> dict[str, Any]:
    """The outcome of one case, how many standard errors each fitted parameter is off its truth, and what this gains.

    ``own``: no effect is offered but the truth's, and what it gains, which takes longer, is not asked.
    """
    effects = {name: effect for name, effect in catalogue().items() if not own or name in TRUTHS[case.truth]}
    found = discover(campaign(case, 1000 + case.seed), effects, max_effects=1 if own else 2)
    said = outcome(frozenset(TRUTHS[case.truth]), found.verdict)
    gain = expected_gain(case) if TRUTHS[case.truth] and not own else None
    return {**dataclasses.asdict(case), "outcome": said, "z": standardised(case, found), "gain": gain}


def campaign(case: Case, seed: int) -> Cells:
    """Its trials, their noise and offsets drawn by a seed."""
    shared = NUISANCES[case.nuisance][0]
    rows = direct_trials(case.world, PHI, OMEGA, "UNIFORM", 3, seed, None, case.order, shared)
    return cells_of(from_rows([Row(**row) for row in rows]))


def expected_gain(case: Case) -> float:
    """What the truth gains over the base model, see ``hidden.of_other_draws``."""
    return of_other_draws(partial(_gain, case), case.seed)


def _gain(case: Case, seed: int) -> float:
    """Beside what the trials share, by somebody who knows how far batches differ."""
    cells, week = campaign(case, seed), case.world.week
    apart = BatchSd(week.k_batch_sd, week.lift_zero_batch_sd_m, week.speed_scale_batch_sd)
    base = fit(model_of("simple", (), catalogue()), cells)
    whole = fit(model_of("simple", tuple(TRUTHS[case.truth]), catalogue()), cells, base.warm_start)
    own, starts = nuisances_for(whole, DEFAULT, apart), (base.warm_start, whole.warm_start)
    without, with_it = (
        fitted_at(one.model, cells, solve_near((one.model, cells, starts, own)), own) for one in (base, whole)
    )
    return without.deviance - with_it.deviance


def outcome(hidden: frozenset[str], verdict: Any) -> str:
    """A column of the table: a verdict whose named sets do not hold what is hidden is a false claim."""
    named = [frozenset(one) for one in verdict.alternatives] or [frozenset(verdict.effects)]
    if verdict.status in NAMES_EFFECTS and hidden not in named:
        return "false claim"
    return "named" if verdict.status == "identified" else str(verdict.status)


def standardised(case: Case, found: Any) -> dict[str, float]:
    """(estimate - truth)/σ of Δt, each k and the effect's parameters, by the step whose effects are the truth's: as
    reported where the verdict names it, else as tried; nothing where every set is refused.
    """
    step = next((one for one in (found.fit, *found.fits) if set(one.effects) == set(TRUTHS[case.truth])), None)
    if step is None or found.verdict.status == "unexplained":
        return {}
    true = {"delta_t_s": case.world.delta_t_s}
    true |= {f"{name}.{key}": value for name, keys in TRUTHS[case.truth].items() for key, value in keys.items()}
    return off_by(step, true, case.world)


def off_by(fit: Any, true: Mapping[str, float], world: World) -> dict[str, float]:
    """(estimate - truth)/σ of the parameters that are ``true`` by their names, and of each k; where there is a σ."""
    z = {
        name: (one.value - true[name]) / one.stderr
        for name, one in fit.parameters.items()
        if name in true and np.isfinite(one.stderr) and one.stderr > 0
    }
    for index, (phi, k, error) in enumerate(zip(fit.level_phi, fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True)):
        if np.isfinite(error) and error > 0:
            z[f"k[{index}]"] = (k - usual_k(world, float(phi))) / error
    return {name: float(value) for name, value in z.items()}


def usual_k(world: World, phi: float) -> float:
    """k over the campaign as a whole, at the φ that was read: drift and jumps move it from where it began."""
    week = world.week
    jumps = sum(1.0 - place for place in week.k_jumps_at) * math.log1p(week.k_jump)
    return world.stiffness_n_per_m(phi - week.phi_zero) * math.exp(0.5 * math.log1p(week.k_drift) + jumps)


def report(results: Sequence[Mapping[str, Any]]) -> str:
    """A row for each nuisance, dose and order, with nothing hidden and with an effect, in Markdown."""
    coverage = ["Δt 1σ/2σ", "k 1σ/2σ", "effect 1σ/2σ"]
    head = ["nuisance", "dose", "order", "hidden", "worlds", *STATUSES, "found if it can be", *coverage]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for key in sorted(set(map(_row, results)), key=_place):
        some = [one for one in results if _row(one) == key]
        counts = Counter(one["outcome"] for one in some)
        shares = [covered(some, kind) for kind in ("delta_t_s", "k[", ".")]
        numbers = [len(some), *(counts[one] for one in STATUSES)]
        lines.append(f"| {' | '.join([*key, *map(str, numbers), _found_if_it_can_be(some), *shares])} |")
    return "\n".join(lines) + "\n"


def _found_if_it_can_be(some: Sequence[Mapping[str, Any]]) -> str:
    """How many are named, alone or in a set, of those whose effect is expected to gain ``CLEAR`` beside what trials
    share."""
    told = [one for one in some if (one.get("gain") or 0.0) >= CLEAR]
    found = sum(one["outcome"] in ("named", "partial", "ambiguous") for one in told)
    return f"{found} of {len(told)}" if told else "–"


def _row(one: Mapping[str, Any]) -> tuple[str, str, str, str]:
    return one["nuisance"], one["dose"], one["order"], "an effect" if TRUTHS[one["truth"]] else "nothing"


def _place(row: tuple[str, str, str, str]) -> tuple[int, ...]:
    nuisance, dose, order, hidden = row
    return list(NUISANCES).index(nuisance), (*DOSES, FROM_PRIORS).index(dose), ORDERS.index(order), hidden != "nothing"


def _right(one: Mapping[str, Any]) -> bool:
    return bool(one["outcome"] == ("named" if TRUTHS[one["truth"]] else "adequate"))


def _together(results: Sequence[Mapping[str, Any]]) -> str:
    """Coverage of all rows together, by dose and by order, in Markdown."""
    parts = {"clean": [one for one in results if one["nuisance"] == "clean"]}
    parts |= {dose: [one for one in results if one["nuisance"] != "clean" and one["dose"] == dose] for dose in DOSES}
    parts |= {order: [one for one in results if one["order"] == order] for order in ORDERS}
    lines = ["| | Δt | k | effect |", "|---|---|---|---|"]
    for name, some in parts.items():
        shares = [covered(some, kind) for kind in ("delta_t_s", "k[", ".")]
        lines.append(f"| {name} | {' | '.join(shares)} |")
    return "\n".join(lines)


def document(results: Sequence[Mapping[str, Any]]) -> str:
    """The whole report, in Markdown."""
    seeds = len({one["seed"] for one in results})
    lines = [
        "# Verdicts under the nuisances of a real week in a lab",
        "",
        f"{len(results)} campaigns of {len(PHI)} φ × {len(OMEGA)} ω × 3 trials, {seeds} seed(s) of the matrix; "
        f"`discover` with up to two effects. Hidden: nothing, or one of {', '.join(EFFECTS)} in turn. "
        "A false claim names effects, with the hidden one not among its alternatives. An effect counts as detectable "
        f"if its expected gain in deviance is {CLEAR:g} with nuisances, as in hidden.md. A dose is the size of a "
        "nuisance; the signs of reading errors, drifts and jumps, and the time of a jump, are drawn anew for each "
        "seed. Rows share the noise of a seed, so their coverages are not independent, least of all of k and Δt of one "
        "seed.",
        "",
    ]
    for dose in ("clean", *DOSES):
        some = [one for one in results if dose == ("clean" if one["nuisance"] == "clean" else one["dose"])]
        right = sum(map(_right, some))
        false = sum(one["outcome"] == "false claim" for one in some)
        lines.append(f"* {dose}: {right} of {len(some)} right, {false} false claims")
    wrong = "; ".join(
        f"{one['nuisance']}, {one['dose']}, {one['order']}, {one['truth']}, seed {one['seed']}: {one['outcome']}"
        for one in results
        if not _right(one)
    )
    lines += ["", report(results), resolution(seeds), ""]
    lines += ["Coverage, all rows together, within 1σ/2σ:", "", _together(results)]
    return "\n".join([*lines, "", f"Not right: {wrong or 'none'}."])


def covered(some: Sequence[Mapping[str, Any]], kind: str) -> str:
    """Shares of z within 1 and 2, of all names with ``kind`` in them."""
    z = np.abs([value for one in some for name, value in one["z"].items() if kind in name])
    return f"{np.mean(z < 1):.2f}/{np.mean(z < 2):.2f}" if len(z) else "–"


def resolution(seeds: int) -> str:
    """What coverage over so many seeds can show, in one sentence."""
    inside, usual = [], []
    for nominal, (low, high) in zip(NOMINAL, BANDS, strict=True):
        chance = [math.comb(seeds, n) * nominal**n * (1 - nominal) ** (seeds - n) for n in range(seeds + 1)]
        inside.append(sum(p for n, p in enumerate(chance) if low <= round(n / seeds, 9) <= high))
        below = np.cumsum(chance)
        usual.append("{:.2f} to {:.2f}".format(*np.searchsorted(below, (0.025, 0.975)) / seeds))
    bands = ["{:.2f} to {:.2f}".format(*band) for band in BANDS]
    return (
        f"With {seeds} seeds a row, an exact 0.68 lies within {bands[0]} in only {inside[0]:.0%} of rows, and an exact "
        f"0.95 within {bands[1]} in {inside[1]:.0%}: of one z a seed, a row can show no more than whether coverage is "
        f"within {usual[0]} and {usual[1]} (95 %)."
    )


def _figures_of(results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    right = list(map(_right, results))
    false = [one["outcome"] == "false claim" for one in results]
    return [
        *share("verdicts right under a week's nuisances", "campaigns", right, "≥ 95 %"),
        *share("false claims under a week's nuisances", "campaigns", false, "≤ 2 %"),
    ]


_matrix = Matrix(analyse, lambda: list(cases(1))[::EVERY], lambda: list(cases(QUICK_SEEDS)), OUT, document, _figures_of)
sample, main, figures = _matrix.sample, _matrix.main, _matrix.figures


def command() -> None:
    """Run what is missing of a part and print its table."""
    parser = options(__doc__, SEEDS, OUT, "a nuisance or a truth")
    parser.add_argument("--drawn", action="store_true", help="weeks drawn from the priors of discover")
    parser.add_argument("--own", action="store_true", help="no effects but the truth's; give a file of its own")
    args = parser.parse_args()
    wanted = list(cases(args.seeds, args.only, args.drawn))
    print(report(collect(partial(analyse, own=args.own), wanted, args.out, args.workers)))


if __name__ == "__main__":
    command()
