"""Discovery against its peers on the same hidden worlds: who names the effect, who predicts cells it has not seen.

Truth stays in ``hidden``: every method gets the trials table and nothing else.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from _figures import Figure, share
from _peers import (
    CATALOGUE,
    Choice,
    Named,
    Predict,
    base_alone,
    gp_discrepancy,
    lmfit_aic,
    physical,
    polynomial,
    sindy,
    speed_of,
    speed_only,
)
from hidden import NULL, OMEGA, PHI, WORLDS, Hidden
from sandbot_common.arrays import Bools
from sandbot_model.data.clustering import phi_levels
from sandbot_model.data.conditions import cells_of, noise_floor
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.result import Discovery
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.trials.table import Trials

SEPARABLE = (
    "disturbed_ground",
    "exact_vertical_acceleration",
    "exact_leg_arc",
    "stance_overlap",
    "swimming_thrust",
    "crater_refill",
    "phi_dependent_response",
    "belly_coast",
    "motor_saturation",
    "carried_momentum",
    "inertial_drag",
    "slow_phase_speed",
)
KINDS = ("separable", "pair", "null", "outside")
NULL_SEEDS, OUTSIDE, PAIRS = 4, 4, 2
MAX_EFFECTS = 2
"""For everybody."""
HELD_OUT = 12
"""Cells held out one at a time."""
BETTER = 0.05
FAR = 3.0
"""Noise floors by which a cell's mean is missed."""


def ours(trials: Trials) -> Choice:
    """``discover`` with everything that was measured; predictions are those of the set it ends with."""
    found = _discovered(trials)
    last = found.steps[-1]
    named: Named = ()
    if found.verdict.status in ("identified", "ambiguous"):
        named = tuple(frozenset(one) for one in found.verdict.alternatives)
    return Choice(named, lambda others: speed_of(fit(last.model, cells_of(others), last.warm_start)))


def _discovered(trials: Trials) -> Discovery:
    """The same search serves two methods, one after the other."""
    for known, found in _DISCOVERED:
        if known is trials:
            return found
    found = discover(cells_of(trials), CATALOGUE, max_effects=MAX_EFFECTS)
    _DISCOVERED[:] = [*_DISCOVERED[-1:], (trials, found)]
    return found


_DISCOVERED: list[tuple[Trials, Discovery]] = []


def ours_with_formula(trials: Trials) -> Choice:
    """The same, and where nothing of the catalogue fits, with the formula it offers added."""
    choice, found = ours(trials), _discovered(trials)
    left = found.residual
    if left is None:
        return choice
    model = model_of(found.model, (*left.effects, left.name), catalogue(formulas=[left.formula]))
    near = found.steps[0].warm_start
    return Choice(choice.named, lambda others: speed_of(fit(model, cells_of(others), near)))


def ours_speed_only(trials: Trials) -> Choice:
    """The same, given mean speed alone."""
    choice = ours(speed_only(trials))
    return Choice(choice.named, lambda others: choice.refit(speed_only(others)))


WITH_FORMULA = "discover, and the formula it offers"
METHODS: Mapping[str, Callable[[Trials], Choice]] = {
    "discover": ours,
    WITH_FORMULA: ours_with_formula,
    "discover, mean speed alone": ours_speed_only,
    "lmfit + AIC, all observables": lmfit_aic((0, 1, 2, 3)),
    "lmfit + AIC, mean speed alone": lmfit_aic((0,)),
    "PySINDy, physical terms on the base's residual": sindy(physical, on_base=True),
    "PySINDy, polynomial in (φ, ω)": sindy(polynomial, on_base=False),
    "base + Gaussian process": gp_discrepancy,
    "base model alone": base_alone,
}

WITHOUT_COLUMN = (ours_speed_only,)
"""Left out of extrapolation, to save minutes."""


@dataclass(frozen=True)
class Score:
    """One method in one world; errors in m/s."""

    method: str
    world: Hidden
    named: Named
    seconds: float
    cell_gaps: tuple[float, ...]
    """Of each held-out trial: measured minus predicted, its cell being out."""
    corner_gaps: tuple[float, ...]
    """The same with the whole fastest column out; empty where that was not tried."""
    floor: float

    @property
    def first(self) -> bool:
        """What it names first is the truth."""
        return bool(self.named) and self.named[0] == frozenset(self.world.truth)

    @property
    def mixed(self) -> bool:
        """What it names first is the truth and something else."""
        return bool(self.named) and self.named[0] > frozenset(self.world.truth)

    @property
    def among(self) -> bool:
        """The truth is among what it names."""
        return frozenset(self.world.truth) in self.named

    @property
    def missed(self) -> int:
        """Held-out cells whose mean is missed by more than ``FAR`` noise floors."""
        means = np.reshape(self.cell_gaps, (HELD_OUT, -1)).mean(axis=1)
        return int((np.abs(means) > FAR * self.floor).sum())


def worlds() -> list[tuple[Hidden, int]]:
    """Which worlds, with their seeds; those that take longest come first."""
    first = [next(one for one in WORLDS if one.truth == (name,)) for name in SEPARABLE]
    outside = list({one.truth: one for one in WORLDS if one.kind == "outside"}.values())[:OUTSIDE]
    pairs = [one for one in WORLDS if one.kind == "pair"][:PAIRS]
    null = [(NULL, 1000 + seed) for seed in range(NULL_SEEDS)]
    return [(one, 0) for one in (*outside, *pairs, *first)] + null


def cells_to_hold_out(trials: Trials) -> list[Bools]:
    """Masks ``(trials,)`` of the cells that are held out, the same for every method and world."""
    level, omega = phi_levels(np.asarray(trials.phi, dtype=float)), np.asarray(trials.omega_rad_s, dtype=float)
    keys = [(one, frequency) for one in np.unique(level) for frequency in np.unique(omega)]
    chosen = np.random.default_rng(0).permutation(len(keys))[:HELD_OUT]
    return [(level == keys[i][0]) & (omega == keys[i][1]) for i in chosen]


def fastest_column(trials: Trials) -> Bools:
    """Mask ``(trials,)`` of the highest leg frequency."""
    omega = np.asarray(trials.omega_rad_s, dtype=float)
    return np.asarray(omega == omega.max())


def gaps(predict: Predict, held: Trials) -> list[float]:
    """Measured minus predicted mean speed [m/s] of the held-out trials, each cell predicted at its mean φ."""
    phi, omega = np.asarray(held.phi, dtype=float), np.asarray(held.omega_rad_s, dtype=float)
    level = phi_levels(phi)
    centre = np.array([phi[(level == one) & (omega == w)].mean() for one, w in zip(level, omega, strict=True)])
    return (np.asarray(held.speed_m_s, dtype=float) - predict(centre, omega)).tolist()


def run(task: tuple[Hidden, int]) -> list[Score]:
    """Every method in one world."""
    world, seed = task
    trials = world.trials(seed)
    floor = noise_floor(cells_of(trials))["speed"]
    corner = fastest_column(trials)
    blind = trials.select(~corner)
    found = []
    for name, method in METHODS.items():
        with threadpool_limits(1):
            began = time.process_time()
            choice = method(trials)
            seconds = time.process_time() - began
            cells: list[float] = []
            for held in cells_to_hold_out(trials):
                cells += gaps(choice.refit(trials.select(~held)), trials.select(held))
            # What is chosen has seen all cells but for extrapolation, where that would tell too much.
            beyond: list[float] = []
            if method not in WITHOUT_COLUMN:
                beyond = gaps(method(blind).refit(blind), trials.select(corner))
        found.append(Score(name, world, choice.named, seconds, tuple(cells), tuple(beyond), floor))
    return found


def report(scores: Sequence[Score]) -> str:
    """The section of the report, in Markdown."""
    by = {kind: [one for one in scores if one.world.kind == kind] for kind in KINDS}
    ordered = [one for kind in KINDS for one in by[kind]]
    lines = [
        "# Discovery and its peers",
        "",
        f"{_worlds(scores)} hidden worlds of the virtual lab, {len(PHI)} φ × {len(OMEGA)} ω × 3 trials each: "
        + ", ".join(f"{_worlds(some)} {kind}" for kind, some in by.items())
        + ".",
        "",
        *_naming(by, ordered),
        "",
        *_prediction(by),
        "",
        *_world_by_world(ordered),
        "",
        GIVEN,
    ]
    return "\n".join(lines)


def _naming(by: Mapping[str, Sequence[Score]], scores: Sequence[Score]) -> list[str]:
    lines = [
        "## Which method names the effect",
        "",
        "| method | separable: truth first | truth with further effects | truth among named | sets named (median) "
        "| pairs: truth first | null: false claim | outside the catalogue: claims an effect | CPU s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in METHODS:
        separable, pair, null, outside = (_of(by[kind], name) for kind in KINDS)
        cells = [
            _share([one.first for one in separable]),
            _share([one.mixed for one in separable]),
            _share([one.among for one in separable]),
            f"{_median([len(one.named) for one in separable]):g}",
            _share([one.first for one in pair]),
            _share([bool(one.named) for one in null]),
            _share([bool(one.named) for one in outside]),
            f"{_median([one.seconds for one in _of(scores, name)]):.1f}",
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


def _prediction(by: Mapping[str, Sequence[Score]]) -> list[str]:
    groups = {"catalogue effect": [*by["separable"], *by["pair"]], "outside": by["outside"], "null": by["null"]}
    errors: dict[str, dict[str, float]] = {}
    for name in METHODS:
        cells = {
            f"cells: {key}": [_rms(s.cell_gaps) / s.floor for s in _of(group, name)] for key, group in groups.items()
        }
        column = {
            f"column: {key}": [100 * _rms(s.corner_gaps) for s in _of(group, name)] for key, group in groups.items()
        }
        errors[name] = {head: _median(values) for head, values in (cells | column).items()}
    heads = list(errors["discover"])
    lines = [
        "## Which method predicts unseen conditions",
        "",
        f"RMS error of mean speed over held-out trials, median over worlds. {HELD_OUT} cells, one held out at a time, "
        "relative to the noise floor (1: as accurate as replicates; missed: the cell's mean is wrong by more than "
        f"{FAR:g} floors); and the whole ω = {max(OMEGA):g} rad/s column held out, in cm/s.",
        "",
        f"| method | {' | '.join(heads)} | cells missed |",
        "|---" * (len(heads) + 2) + "|",
    ]
    everywhere = [one for group in groups.values() for one in group]
    for name, row in errors.items():
        missed = [one.missed for one in _of(everywhere, name)]
        values = " | ".join(_number(row[head]) for head in heads)
        lines.append(f"| {name} | {values} | {sum(missed)} of {HELD_OUT * len(missed)} |")
    return [*lines, "", *_better(errors)]


def _better(errors: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Where a peer predicts better than all that discover offers by more than ``BETTER``."""
    lines, peers = [], {name: row for name, row in errors.items() if not name.startswith("discover")}
    for head, mine in errors[WITH_FORMULA].items():
        ahead = [(row[head], name) for name, row in peers.items() if row[head] < mine / (1 + BETTER)]
        if ahead:
            names = ", ".join(f"{name} ({_number(value)})" for value, name in sorted(ahead))
            lines.append(f"* {head}: {WITH_FORMULA} {_number(mine)}; better: {names}")
    said = f"Better than {WITH_FORMULA} by more than {100 * BETTER:.0f} %" + (":" if lines else ": nobody.")
    return [said, *([""] if lines else []), *lines]


def _world_by_world(scores: Sequence[Score]) -> list[str]:
    shown = [name for name in METHODS if any(one.named for one in scores if one.method == name)]
    lines = ["## World by world", "", f"| world | {' | '.join(shown)} |", "|---" * (len(shown) + 1) + "|"]
    for world in dict.fromkeys(one.world.name for one in scores):
        row = []
        for name in shown:
            some = [one for one in scores if one.method == name and one.world.name == world]
            row.append("; ".join(dict.fromkeys(_said(one) for one in some)))
        lines.append(f"| {world} | {' | '.join(row)} |")
    return lines


def _said(one: Score) -> str:
    """The first it names, and how many more."""
    if not one.named:
        return "–"
    more = f" (+{len(one.named) - 1})" if len(one.named) > 1 else ""
    mark = " ✓" if one.first else " (✓)" if one.among else ""
    return " + ".join(sorted(one.named[0])) + more + mark


def _of(scores: Sequence[Score], method: str) -> list[Score]:
    return [one for one in scores if one.method == method]


def _worlds(scores: Sequence[Score]) -> int:
    return len(_of(scores, "discover"))


def _share(right: Sequence[bool]) -> str:
    return f"{sum(right)}/{len(right)}"


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def _number(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"


GIVEN = f"""## What each method was given

All methods: the trials table (φ, ω and the four observables of every trial) and the project's model as a function,
but not the truth. *Named* is every set of effects a method gives as an explanation, the best first; naming nothing is
an answer too. Held-out cells: the model chosen from all trials is refitted without the cell. Held-out column: it is
also chosen without it.
* discover: as shipped, sets of up to {MAX_EFFECTS} effects. It names the alternatives of `identified` and
  `ambiguous`, nothing when `adequate` or `unexplained`; it predicts with the last set of its ladder, even if it says
  that this is not the truth. In that case it offers a formula for the remaining misfit; the second row adds this as
  `compare --effect` does (its search is that of the first row, and its time is not counted again).
* lmfit + AIC: the whole catalogue as candidate models, `least_squares` on single trials with one k per φ level and
  all parameters bounded, starts from a grid (Δt × weak, medium or strong effect × k level by level) and from the
  smaller model's optimum; all observables are scaled by their usual noise. An effect, and then a second, is named if
  AIC falls by more than 10; alternatives are the sets within 2 of the best. Replicates are not used, so it can't
  report that nothing fits.
* PySINDy: FROLS with up to 8 terms, STLSQ and SR3 at 8 sparsities each, selected by BIC (Mangan et al. 2017; AIC
  keeps more terms). The polynomial library (degree 4) regresses mean speed. The physical one regresses the residual
  of mean speed of the base model at its global optimum; 10 of its 19 terms equal an effect to first order and are
  counted as naming it: v̄ itself stance_overlap, v̄ Fr motor_saturation, v̄ (d_r/d)² leg_slip, v̄ [s < 0.95 R]
  disturbed_ground, ω³ (d+h-R)² belly_coast, 1/ω for swimmers swimming_thrust, and through ∂v̄/∂F a constant force
  cohesion, (Rω)² inertial_drag, Rω (1 - s/2R) exact_vertical_acceleration and Rω (φ - φ_0) phi_dependent_response.
  Two of them together count as a pair; they are named only if BIC falls by more than 10. exact_leg_arc,
  crater_refill, carried_momentum and slow_phase_speed have no such term and can't be named.
* Gaussian process: Kennedy & O'Hagan's discrepancy on the base model at its global optimum, anisotropic RBF or Matérn
  3/2 with noise by marginal likelihood (scikit-learn). A discrepancy names nothing: it only predicts.
* base model alone: fitted to mean speed by this project's fit."""


def sample() -> list[Figure]:
    """One world of each kind, and who names what is hidden there."""
    tasks = list({task[0].kind: task for task in worlds()}.values())
    with ProcessPoolExecutor() as pool:
        scores = [one for some in pool.map(run, tasks) for one in some]
    peers = {name: _of(scores, name) for name in METHODS}
    right = {name: sum(_right(one) for one in some) for name, some in peers.items()}
    best = max(count for name, count in right.items() if not name.startswith("discover"))
    held = [_right(one) for one in peers[WITH_FORMULA]]
    return share("correctly named, or correctly not named", f"worlds; the best peer {best}", held, "≥ 95 %")


def _right(one: Score) -> bool:
    """The truth first; nothing where there is none, or none that the catalogue has."""
    return not one.named if one.world.kind in ("null", "outside") else one.first


def main() -> str:
    """Run every method in every world; the section of the report, in Markdown."""
    with ProcessPoolExecutor() as pool:
        tasks = worlds()
        return report([one for some in tqdm(pool.map(run, tasks), total=len(tasks)) for one in some])


if __name__ == "__main__":
    print(main())
