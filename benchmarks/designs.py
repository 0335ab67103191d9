"""Verdicts of campaigns nobody planned for: design, ground, noise, gait, what was measured and the week drawn at random.

python benchmarks/designs.py [--campaigns 400] [--first 0] [--out runs/designs.jsonl] [--workers N]    resumes

The other matrices ask much of one design, 7 φ × 7 ω × 3; this one asks a little of hundreds. What is found here is a
fault more often than a rate: a crash, a fit that stays in a valley, a claim that stands on a value nobody believes.
"""

import argparse
import dataclasses
import math
import traceback
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from _figures import Figure, share
from _matrix import collect
from hidden import NULL, WORLDS, Hidden
from nuisance import DRAWN, drawn
from sandbot_lab.direct import direct_trials
from sandbot_lab.week import Week
from sandbot_lab.world import Noise, World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import Discovery, discover
from sandbot_model.physics.catalogue import catalogue
from sandbot_record.trials.table import Row, Trials, from_rows

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
ALIKE = frozenset({"leg_slip", "cable_drag", "bed_slope"})
CLOCK = "slow_phase_speed"
"""What the lab has by itself in gaits whose slow phase is slower than their clock."""
OUTCOMES = ("named", "in part", "adequate", "unexplained", "untested", "false claim", "crash")


@dataclass(frozen=True)
class Case:
    """One campaign, by its number."""

    number: int
    measured: str

    @cached_property
    def draw(self) -> np.random.Generator:
        """Where everything else about it comes from."""
        return np.random.default_rng([self.number, 0xDE51])


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
    draw = case.draw
    hidden = NULL if draw.random() < NULLS else WORLDS[draw.integers(len(WORLDS))]
    knots = np.sort(draw.uniform(150.0, 260.0, 3)) + [0.0, 5.0, 10.0]
    lab = {"k_knots_n_per_m": tuple(knots.tolist()), "delta_t_s": float(draw.uniform(0.2, 0.6)), **hidden.lab}
    ends = np.sort(draw.uniform(*PHI, 2))
    phi = np.linspace(*(ends if ends[1] - ends[0] > NARROWEST else PHI), int(draw.integers(3, 10))).round(4)
    omega = np.sort(draw.uniform(*OMEGA, int(draw.integers(3, 9)))).round(1)
    replicates, gait = int(draw.choice([1, 2, 2, 3, 3, 4, 6])), str(draw.choice(["UNIFORM", "UNIFORM", "SGCS"]))
    scale, swim = math.exp(draw.uniform(-0.7, 1.0)), float(draw.uniform(0.005, 0.04))
    in_a_week = draw.random() < WEEKS
    world = World(
        effects={name: dict(values) for name, values in hidden.effects.items()},
        noise=Noise(scale=scale),
        swim_m_s=swim,
        week=drawn(case.number) if in_a_week else Week(),
        **lab,
    )
    order = draw.choice(["as_listed", "randomised"]) if in_a_week else draw.choice([None, "as_listed", "randomised"])
    batches = str(draw.choice(DRAWN)) if in_a_week else "clean"
    gait = hidden.gait if hidden.gait != "UNIFORM" else gait
    return Campaign(hidden, world, phi.tolist(), omega.tolist(), gait, replicates, batches, order)
