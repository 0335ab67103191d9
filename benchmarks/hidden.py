"""Hidden worlds: the virtual lab plants an effect, the analysis must name it.

Truth stays here: ``discover`` gets the trials table and nothing else.
"""

import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from _figures import Figure, share
from sandbot_lab.direct import direct_trials
from sandbot_lab.world import Noise, World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.trials.table import Row, Trials, from_rows

NULLS, MAX_EFFECTS, EVERY = 100, 3, 7
REPEATS = {1.0: {"separable": 3, "alike": 1, "faint": 1, "outside": 2, "pair": 2}}
"""Seeds of each kind at each scale of the noise; one at half and at twice the usual."""
REPEATS |= {scale: {"separable": 1, "outside": 1, "pair": 1, "null": 20} for scale in (0.5, 2.0)}
CLEAR = 50.0
"""Expected gain in deviance from which an effect must be found: twice what a claim takes (``Criteria.claim``)."""
DRAWS, DOUBTFUL = 3, 4.0
"""Draws of the noise from which the expected gain is taken where one leaves a doubt."""
PHI = np.linspace(0.58, 0.633, 7).tolist()
OMEGA = [4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0]
SOFT = {"k_knots_n_per_m": (110.0, 132.0, 142.0)}
"""On an arc the same ground carries more: at these k the robot of the arc walks and swims as the other does."""


@dataclass(frozen=True)
class Hidden:
    """A world of the lab and what a perfect analysis says of it.

    ``kind`` is null, separable (must be identified), alike (an equivalence class must name it), faint (nothing these
    observables show: adequate, or a named set that holds it), outside (must not be identified) or pair.
    """

    name: str
    kind: str
    truth: tuple[str, ...]
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    lab: Mapping[str, Any] = field(default_factory=dict)
    gait: str = "UNIFORM"

    def world(self, noise: float = 1.0) -> World:
        """The lab's world; ``noise`` scales every scatter between replicates."""
        effects = {name: dict(values) for name, values in self.effects.items()}
        return World(effects=effects, noise=Noise(scale=noise), **self.lab)

    def trials(
        self,
        seed: int,
        phi: Sequence[float] = PHI,
        omega: Sequence[float] = OMEGA,
        replicates: int = 3,
        noise: float = 1.0,
    ) -> Trials:
        """What the lab measures directly, without cameras."""
        rows = direct_trials(self.world(noise), phi, omega, self.gait, replicates, seed)
        return from_rows([Row(**row) for row in rows])


def _single(kind: str, name: str, strengths: Sequence[Mapping[str, float]], **lab: Any) -> Iterator[Hidden]:
    for values in strengths:
        text = ", ".join(f"{key}={value:g}" for key, value in values.items())
        yield Hidden(f"{name}({text})", kind, (name,), {name: values}, lab)


def _each(key: str, *values: float, **more: float) -> list[dict[str, float]]:
    return [{key: value, **more} for value in values]


def _pair(*parts: tuple[str, Mapping[str, float]]) -> Hidden:
    names = tuple(name for name, _ in parts)
    return Hidden(" + ".join(names), "pair", names, dict(parts))


OVERLAP = ("stance_overlap", {"eta": 0.1})
THRUST = ("swimming_thrust", {"a_m_s2": 0.35})
LATE = ("phi_dependent_response", {"b": 0.8})
PAIRS = (
    (("disturbed_ground", {"k_l_n_per_m": 175.0, "s_c": 0.95}), OVERLAP),
    (("disturbed_ground", {"k_l_n_per_m": 175.0, "s_c": 0.95}), THRUST),
    (("exact_vertical_acceleration", {}), OVERLAP),
    (("exact_vertical_acceleration", {}), THRUST),
    (("crater_refill", {"z0_m": 0.008, "tau_s": 0.15}), OVERLAP),
    (("carried_momentum", {"chi_m": 0.5}), OVERLAP),
    (("motor_saturation", {"omega_s_rad_s": 60.0}), OVERLAP),
    (OVERLAP, LATE),
    (OVERLAP, THRUST),
    (LATE, THRUST),
)

DISTURBED = [{"k_l_n_per_m": k, "s_c": s} for k, s in ((175.0, 0.95), (170.0, 1.0), (182.0, 0.9))]

WORLDS: tuple[Hidden, ...] = (
    *_single("separable", "disturbed_ground", DISTURBED),
    *_single("separable", "exact_vertical_acceleration", [{}]),
    *_single("separable", "exact_leg_arc", [{"tip_deg": 45.0}], **SOFT),
    *_single("separable", "stance_overlap", _each("eta", 0.05, 0.1, 0.2)),
    *_single("separable", "swimming_thrust", _each("a_m_s2", 0.2, 0.32, 0.45)),
    *_single("separable", "crater_refill", [{"z0_m": 0.01, "tau_s": 0.15}, {"z0_m": 0.006, "tau_s": 0.1}]),
    *_single("separable", "phi_dependent_response", _each("b", -0.4, 0.6, 1.0)),
    *_single("separable", "belly_coast", _each("mu_b", 0.4, 0.9)),
    *_single("separable", "motor_saturation", _each("omega_s_rad_s", 50.0, 90.0)),
    *_single("separable", "carried_momentum", _each("chi_m", 0.3, 0.6)),
    *_single("separable", "inertial_drag", _each("lambda_", 1.0, 2.0)),
    Hidden("slow_phase_speed(SGCS)", "separable", ("slow_phase_speed",), {}, {"delta_t_s": 0.2}, "SGCS"),
    *_single("alike", "leg_slip", _each("sigma", 0.05, 0.1, 0.18)),
    *_single("alike", "cable_drag", _each("f_c_n", 0.15, 0.3)),
    *_single("alike", "bed_slope", _each("chi_deg", 1.5)),
    *_single("separable", "phi_nonuniformity", _each("sigma_phi", 0.004)),
    *_single("faint", "cohesion", _each("c_pa", 300.0)),
    *_single("faint", "depth_nonlinearity", _each("n", 1.25)),
    *_single("faint", "added_mass", _each("c_g", 2.7)),
    *_single("faint", "unequal_leg_load", _each("x", 0.15)),
    *_single("faint", "finite_depth", [{"length_m": 0.02, "bed_m": 0.1}]),
    *_single("faint", "dilation", [{"xi": 0.7, "phi_c": 0.6, "s_c": 0.95}]),
    *_single("outside", "x_foot_clogging", [{"loss": 0.3, "omega_0_rad_s": 15.0, "width_rad_s": 4.0}]),
    *_single("outside", "x_resonance", [{"loss": 0.3, "omega_0_rad_s": 12.0, "width_rad_s": 2.0}]),
    *_single("outside", "x_traction_loss", _each("loss", 0.2, 0.4)),
    *_single("outside", "x_ageing", [{"loss": 0.2, "steps": 10.0}]),
    *_single("outside", "x_periodic_strength", [{"amplitude": 0.2, "length_m": 0.2}]),
    *_single("outside", "x_belly_suction", _each("force_n", 1.5)),
    *(_pair(*pair) for pair in PAIRS),
)

NULL = Hidden("null", "null", ())


@dataclass(frozen=True)
class Case:
    """A world to analyse once."""

    world: Hidden
    seed: int
    noise: float = 1.0
    max_effects: int = MAX_EFFECTS


@dataclass(frozen=True)
class Outcome:
    """What the analysis said of one world. ``gain`` is what the truth was to gain, expected from other seeds."""

    world: Hidden
    noise: float
    gain: float
    status: str
    named: tuple[frozenset[str], ...]
    cv_over_floor: float
    seconds: float

    @property
    def kind(self) -> str:
        """That of the world; faint where this much noise hides it."""
        hidden = self.world.kind in ("separable", "pair") and self.gain < CLEAR
        return "faint" if hidden else self.world.kind

    @property
    def first_right(self) -> bool:
        """Identified, and it is the truth."""
        return self.status == "identified" and self.named[0] == frozenset(self.world.truth)

    @property
    def in_named(self) -> bool:
        """The truth is among what is named."""
        return self.status in ("identified", "ambiguous") and frozenset(self.world.truth) in self.named

    @property
    def good(self) -> bool:
        """As a perfect analysis would, given the observables."""
        return {
            "null": self.status == "adequate",
            "separable": self.first_right,
            "pair": self.first_right,
            "alike": self.in_named,
            "faint": self.in_named or self.status in ("adequate", "unexplained") or self._part_named,
            "outside": self.status != "identified",
        }[self.kind]

    @property
    def _part_named(self) -> bool:
        """Of a pair of which one is too faint, the other."""
        return any(one < frozenset(self.world.truth) for one in self.named if one)


def run(case: Case) -> Outcome:
    """One world, one seed: the analysis sees the trials and nothing else."""
    return judged(case, case.world.trials(case.seed, noise=case.noise), expected_gain(case))


def judged(case: Case, trials: Trials, gain: float) -> Outcome:
    """What the analysis says of trials, however they were measured."""
    cells = cells_of(trials)
    began = time.process_time()
    found = discover(cells, catalogue(), max_effects=case.max_effects)
    seconds = time.process_time() - began
    verdict = found.verdict
    named = tuple(frozenset(one) for one in verdict.alternatives)
    ratio = found.steps[-1].cv_rmse_m_s / found.noise_floor_m_s
    return Outcome(case.world, case.noise, gain, verdict.status, named, ratio, seconds)


def expected_gain(case: Case) -> float:
    """What the truth gains over the best model with one effect less, scaled to the case's noise; NaN if not asked."""
    world = case.world
    if world.kind not in ("separable", "pair") or any(name not in catalogue() for name in world.truth):
        return float("nan")
    return of_other_draws(lambda seed: _gain(world, seed) / case.noise**2, case.seed)


def of_other_draws(gain: Callable[[int], float], seed: int) -> float:
    """A gain in another draw of the usual noise than a seed's; where that comes within a factor of ``DOUBTFUL`` of
    ``CLEAR``, the median of several: in a single one a faint effect may gain four times as much as it mostly does.
    """
    gains = [gain(seed + 10_000)]
    if CLEAR / DOUBTFUL < gains[0] < CLEAR * DOUBTFUL:
        gains += [gain(seed + 10_000 * draw) for draw in range(2, DRAWS + 1)]
    return statistics.median(gains)


def _gain(world: Hidden, seed: int) -> float:
    cells = cells_of(world.trials(seed))
    base = fit(model_of("simple", (), catalogue()), cells)
    parts = [base]
    if len(world.truth) > 1:
        parts = [fit(model_of("simple", (name,), catalogue()), cells, base.warm_start) for name in world.truth]
    whole = fit(
        model_of("simple", world.truth, catalogue()), cells, min(parts, key=lambda one: one.deviance).warm_start
    )
    return min(part.deviance for part in parts) - whole.deviance


def cases() -> list[Case]:
    """The matrix; every case with noise of its own."""
    wanted = [
        (world, noise)
        for noise, repeats in REPEATS.items()
        for world in (*WORLDS, NULL)
        for _ in range(repeats.get(world.kind, 0))
    ]
    wanted += [(NULL, 1.0)] * NULLS
    return [Case(world, 100 + index, noise) for index, (world, noise) in enumerate(wanted)]


def report(outcomes: Sequence[Outcome]) -> str:
    """The outcomes as markdown."""
    lines = [
        "# Hidden worlds",
        "",
        f"{len(outcomes)} worlds of the virtual lab, {len(PHI)} φ × {len(OMEGA)} ω × 3 replicates, each with noise of "
        "its own. An effect with an expected gain in deviance below "
        f"{CLEAR:g} at its noise counts as faint: it may be missed, but must not be mistaken for another.",
        "",
        *_summary(outcomes),
        "",
        "| kind | noise | worlds | adequate | identified: truth | identified: other | ambiguous with truth "
        "| ambiguous without | unexplained | right |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in dict.fromkeys(one.kind for one in outcomes):
        for noise in sorted({one.noise for one in outcomes if one.kind == kind}):
            lines.append(_row(kind, noise, [one for one in outcomes if (one.kind, one.noise) == (kind, noise)]))
    lines += ["", "| world | noise | expected gain | verdicts (count) | cv error / noise floor | CPU s |"]
    lines.append("|---|---|---|---|---|---|")
    for name, noise in dict.fromkeys((one.world.name, one.noise) for one in outcomes):
        some = [one for one in outcomes if (one.world.name, one.noise) == (name, noise)]
        verdicts = Counter(said(one) for one in some)
        text = "; ".join(f"{verdict} ({count})" for verdict, count in verdicts.most_common())
        ratio = statistics.median(one.cv_over_floor for one in some)
        seconds = statistics.median(one.seconds for one in some)
        gain = statistics.median(one.gain for one in some)
        shown = f"{gain:.0f}" if gain == gain else "–"
        lines.append(f"| {name} | {noise:g} | {shown} | {text} | {ratio:.2f} | {seconds:.1f} |")
    return "\n".join(lines) + "\n"


def _asked(outcomes: Sequence[Outcome]) -> list[tuple[str, str, list[bool]]]:
    """What was asked for (issue of the discovery): how much of it, and for which worlds it held."""
    separable = [one for one in outcomes if one.kind == "separable"]
    hidden = [one for one in outcomes if one.kind in ("separable", "alike", "pair")]
    null = [one for one in outcomes if one.kind == "null"]
    outside = [one for one in outcomes if one.kind == "outside"]
    pairs = [one for one in outcomes if one.kind == "pair"]
    found = [one for one in outcomes if one.first_right]
    return [
        ("separable worlds identified, with the truth named first", "≥ 95 %", [one.first_right for one in separable]),
        ("truth in the named set (separable, alike, pairs)", "≥ 99 %", [one.in_named for one in hidden]),
        ("false claims in null worlds", "≤ 2 %", [one.status != "adequate" for one in null]),
        ("worlds outside the catalogue not identified", "≥ 95 %", [one.status != "identified" for one in outside]),
        ("pairs found", "≥ 90 %", [one.first_right for one in pairs]),
        (
            "out-of-sample error ≤ 1.10 × noise floor where identified",
            "≥ 95 %",
            [o.cv_over_floor <= 1.1 for o in found],
        ),
    ]


def _summary(outcomes: Sequence[Outcome]) -> list[str]:
    lines = ["| target | | measured |", "|---|---|---|"]
    for text, wanted, held in _asked(outcomes):
        share = 100 * sum(held) / len(held) if held else float("nan")
        lines.append(f"| {text} | {wanted} | {share:.1f} % ({sum(held)} of {len(held)}) |")
    return lines


def _row(kind: str, noise: float, some: Sequence[Outcome]) -> str:
    counts = [
        sum(one.status == "adequate" for one in some),
        sum(one.first_right for one in some),
        sum(one.status == "identified" and not one.first_right for one in some),
        sum(one.status == "ambiguous" and one.in_named for one in some),
        sum(one.status == "ambiguous" and not one.in_named for one in some),
        sum(one.status == "unexplained" for one in some),
    ]
    good = sum(one.good for one in some)
    cells = " | ".join(map(str, counts))
    return f"| {kind} | {noise:g} | {len(some)} | {cells} | {good} ({100 * good / len(some):.0f} %) |"


def said(one: Outcome) -> str:
    """The verdict in a line of a Markdown table."""
    sets = " \\| ".join(" + ".join(sorted(named)) for named in one.named)
    return f"{one.status}: {sets}" if one.named else one.status


def sample() -> list[Figure]:
    """Every so many of the matrix."""
    with ProcessPoolExecutor() as pool:
        return _figures_of(list(pool.map(run, cases()[::EVERY])))


def main() -> str:
    """Run the matrix; the section of the report, in Markdown."""
    tasks = cases()
    with ProcessPoolExecutor() as pool:
        outcomes = list(tqdm(pool.map(run, tasks), total=len(tasks)))
    _found[:] = _figures_of(outcomes)
    return report(outcomes)


def figures() -> list[Figure]:
    """Those of the last ``main``."""
    return _found


def _figures_of(outcomes: Sequence[Outcome]) -> list[Figure]:
    return [one for text, wanted, held in _asked(outcomes) for one in share(text, "hidden worlds", held, wanted)]


_found: list[Figure] = []
