"""What is said of a ground of another kind: the lab's resistive one, which shares no formula with lab or model.

python benchmarks/second_ground.py [--seeds 4] [--out runs/second_ground.jsonl] [--workers N]    resumes
"""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from _figures import Figure, share
from _matrix import Matrix, collect, options
from hidden import OMEGA, PHI
from sandbot_lab.direct import ReadingErrors, direct_trials
from sandbot_lab.resistive import ResistiveGround
from sandbot_lab.world import World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.physics.catalogue import catalogue
from sandbot_record.trials.table import Row, from_rows

SEEDS, QUICK_SEEDS = 4, 1
OUT = Path("runs/second_ground.jsonl")
GROUNDS = {
    "as the lab has it": ResistiveGround(),
    "hardly softens": ResistiveGround(strength_n_per_m3=6e5, softened=0.8),
    "forgets soon": ResistiveGround(strength_n_per_m3=8e5, shear_m=0.1),
    "glides well": ResistiveGround(belly_friction=0.5, tangential=0.1),
    "even over φ": ResistiveGround(strength_per_phi=1.0, softened_per_phi=0.0),
}
OTHERS = dict.fromkeys(("lift_m", "peak_speed_m_s", "first_step_m"), np.nan)
STATUSES = ("unexplained", "untested", "adequate", "partial", "ambiguous", "identified")


@dataclass(frozen=True)
class Case:
    """One campaign to analyse; with ``noise`` [m/s] as scatter of its speeds."""

    ground: str
    seen: str
    noise: float
    seed: int


def cases(seeds: int) -> list[Case]:
    """Seed by seed, so that a run stopped early has something of every ground."""
    return [
        Case(ground, seen, noise, seed)
        for seed in range(seeds)
        for ground in GROUNDS
        for seen, noise in (("all four", 0.005), ("speed alone", 0.005), ("speed alone", 0.01))
    ]


def analyse(case: Case) -> dict[str, Any]:
    """What the analysis says of one campaign."""
    errors = ReadingErrors(speed_m_s=case.noise, lift_m=3e-4, peak=0.01, first_step_m=1e-3)
    rows = direct_trials(World(resistive=GROUNDS[case.ground]), PHI, OMEGA, "UNIFORM", 3, 3000 + case.seed, errors)
    hidden = OTHERS if case.seen == "speed alone" else {}
    trials = from_rows([Row(**{**row, "speed_sd_m_s": np.nan, **hidden}) for row in rows])
    found = discover(cells_of(trials), catalogue(), max_effects=2)
    return {
        **dataclasses.asdict(case),
        "status": found.verdict.status,
        "effects": list(found.verdict.effects),
        "because": found.verdict.because,
    }


def document(results: Sequence[Mapping[str, Any]]) -> str:
    """A row for each ground and what was seen of it, in Markdown."""
    lines = [
        "# A ground of another kind",
        "",
        f"{len(results)} campaigns of {len(PHI)} φ × {len(OMEGA)} ω × 3 on the lab's resistive ground: resistance of "
        "every element of a leg, softening where it was sheared, Newton's law for the body. No effect of the catalogue "
        "acts there, and the base model has another mechanism: whatever is named is a false claim. Up to 2 effects.",
        "",
        "| ground | seen | scatter of speed [cm/s] | campaigns | " + " | ".join(STATUSES) + " | named |",
        "|" + "---|" * (5 + len(STATUSES)),
    ]
    for key in dict.fromkeys((one["ground"], one["seen"], one["noise"]) for one in results):
        some = [one for one in results if (one["ground"], one["seen"], one["noise"]) == key]
        counts = Counter(one["status"] for one in some)
        named = sorted({" + ".join(one["effects"]) for one in some if one["status"] in STATUSES[3:]})
        cells = [key[0], key[1], f"{100 * key[2]:g}", len(some), *(counts[one] for one in STATUSES), ", ".join(named)]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


def _figures_of(results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    named = [one["status"] in STATUSES[3:] for one in results]
    return share("effects named on ground of another kind", "campaigns", named, "≤ 2 %")


# The sample is of every ground once.
_matrix = Matrix(analyse, lambda: cases(1)[::3], lambda: cases(QUICK_SEEDS), OUT, document, _figures_of)
sample, main, figures = _matrix.sample, _matrix.main, _matrix.figures


def command() -> None:
    """Run what is missing and print the report."""
    args = options(__doc__, SEEDS, OUT).parse_args()
    print(document(collect(analyse, cases(args.seeds), args.out, args.workers)))


if __name__ == "__main__":
    command()
