"""Hidden worlds: the virtual lab plants an effect, the analysis must name it.

Truth stays here: ``discover`` gets the trials table and nothing else.
"""

import statistics
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from sandbot_lab.direct import direct_trials
from sandbot_lab.world import World
from sandbot_model.catalogue import catalogue
from sandbot_model.cells import cells_of
from sandbot_model.discover import Discovery, discover
from sandbot_record.trials import Row, Trials, from_rows

SEEDS, NULLS, MAX_EFFECTS = 1, 100, 3
PHI = np.linspace(0.58, 0.633, 7).tolist()
OMEGA = [4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0]
SOFT = {"k_knots_n_m": (110.0, 132.0, 142.0)}
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

    def trials(
        self, seed: int, phi: Sequence[float] = PHI, omega: Sequence[float] = OMEGA, replicates: int = 3
    ) -> Trials:
        """What the lab measures."""
        world = World(effects={name: dict(values) for name, values in self.effects.items()}, **self.lab)
        return from_rows([Row(**row) for row in direct_trials(world, phi, omega, self.gait, replicates, seed)])


def _single(kind: str, name: str, strengths: Sequence[Mapping[str, float]], **lab: Any) -> Iterator[Hidden]:
    for values in strengths:
        text = ", ".join(f"{key}={value:g}" for key, value in values.items())
        yield Hidden(f"{name}({text})", kind, (name,), {name: values}, lab)


def _each(key: str, *values: float, **more: float) -> list[dict[str, float]]:
    return [{key: value, **more} for value in values]


DISTURBED = [{"k_l_n_m": k, "s_c": s} for k, s in ((175.0, 0.95), (170.0, 1.0), (182.0, 0.9))]

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
    Hidden(
        "disturbed_ground + stance_overlap",
        "pair",
        ("disturbed_ground", "stance_overlap"),
        {"disturbed_ground": DISTURBED[0], "stance_overlap": {"eta": 0.1}},
    ),
    Hidden(
        "exact_vertical_acceleration + swimming_thrust",
        "pair",
        ("exact_vertical_acceleration", "swimming_thrust"),
        {"exact_vertical_acceleration": {}, "swimming_thrust": {"a_m_s2": 0.35}},
    ),
    Hidden(
        "stance_overlap + phi_dependent_response",
        "pair",
        ("stance_overlap", "phi_dependent_response"),
        {"stance_overlap": {"eta": 0.12}, "phi_dependent_response": {"b": 0.8}},
    ),
    Hidden(
        "crater_refill + stance_overlap",
        "pair",
        ("crater_refill", "stance_overlap"),
        {"crater_refill": {"z0_m": 0.008, "tau_s": 0.15}, "stance_overlap": {"eta": 0.1}},
    ),
)

NULL = Hidden("null", "null", ())


@dataclass(frozen=True)
class Outcome:
    """What the analysis said of one world."""

    world: Hidden
    seed: int
    status: str
    named: tuple[frozenset[str], ...]
    base_p: float
    cv_over_floor: float
    seconds: float

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
            "faint": self.in_named or self.status in ("adequate", "unexplained"),
            "outside": self.status != "identified",
        }[self.world.kind]


def outcome(world: Hidden, seed: int, found: Discovery, seconds: float) -> Outcome:
    """Score a discovery."""
    verdict = found.verdict
    named = tuple(frozenset(one) for one in verdict.alternatives) if verdict.alternatives else ()
    last = found.steps[-1]
    ratio = last.cv_rmse_m_s / found.noise_floor_m_s
    return Outcome(world, seed, verdict.status, named, found.steps[0].lack_of_fit_p, ratio, seconds)


def run(task: tuple[Hidden, int, int]) -> Outcome:
    """One world, one seed."""
    world, seed, max_effects = task
    cells = cells_of(world.trials(seed))
    began = time.process_time()
    found = discover(cells, catalogue(), max_effects=max_effects)
    return outcome(world, seed, found, time.process_time() - began)


def report(outcomes: Sequence[Outcome]) -> str:
    """The outcomes as markdown."""
    lines = [
        "# Hidden worlds",
        "",
        f"{len(outcomes)} worlds of the virtual lab, {len(PHI)} φ × {len(OMEGA)} ω × 3.",
        "",
    ]
    lines += [
        "| kind | worlds | adequate | identified: truth | identified: other | ambiguous with truth | ambiguous without "
        "| unexplained | as it should |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in dict.fromkeys(one.world.kind for one in outcomes):
        lines.append(_row(kind, [one for one in outcomes if one.world.kind == kind]))
    lines += ["", "| world | verdicts (count) | cv error / noise floor | CPU s |", "|---|---|---|---|"]
    for name in dict.fromkeys(one.world.name for one in outcomes):
        some = [one for one in outcomes if one.world.name == name]
        verdicts = Counter(_said(one) for one in some)
        text = "; ".join(f"{said} ({count})" for said, count in verdicts.most_common())
        ratio = statistics.median(one.cv_over_floor for one in some)
        seconds = statistics.median(one.seconds for one in some)
        lines.append(f"| {name} | {text} | {ratio:.2f} | {seconds:.1f} |")
    return "\n".join(lines) + "\n"


def _row(kind: str, some: Sequence[Outcome]) -> str:
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
    return f"| {kind} | {len(some)} | {cells} | {good} ({100 * good / len(some):.0f} %) |"


def _said(one: Outcome) -> str:
    sets = " \\| ".join(" + ".join(sorted(named)) for named in one.named)
    return f"{one.status}: {sets}" if one.named else one.status


def main() -> str:
    """Run the matrix; the section of the report, in Markdown."""
    tasks = [(world, seed, MAX_EFFECTS) for seed in range(SEEDS) for world in WORLDS]
    tasks += [(NULL, 1000 + seed, MAX_EFFECTS) for seed in range(NULLS)]
    with ProcessPoolExecutor() as pool:
        return report(list(tqdm(pool.map(run, tasks), total=len(tasks))))
