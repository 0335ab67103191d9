"""What is left where nothing of the catalogue fits: is it put in words, and does adding it repair the model?"""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

from threadpoolctl import threadpool_limits
from tqdm import tqdm

import hidden
from _figures import Figure, share
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.physics.catalogue import catalogue

EVERY = 5
BESIDE = ("x_foot_clogging", "x_resonance", "x_traction_loss")
"""Effects that are also hidden beside one of the catalogue."""
CATALOGUE = catalogue()


@dataclasses.dataclass(frozen=True)
class Left:
    """One world: the verdict, what was said, and what adding it did."""

    case: hidden.Case
    status: str
    said: str
    p: float
    over_floor: tuple[float, float]
    """Error out of sample over the noise floor: base model, formula added as a user adds it."""

    @property
    def repaired(self) -> bool:
        """What remains is within the scatter of replicates, and the error out of sample is that of the noise."""
        return self.p >= DEFAULT.lack_of_fit and self.over_floor[1] <= 1.1


def cases() -> list[hidden.Case]:
    """The outside worlds of the matrix with their noise, and some of them with a stance overlap as well."""
    outside = [one for one in hidden.cases() if one.world.kind == "outside"]
    first = [next(one.world for one in outside if one.world.truth == (name,)) for name in BESIDE]
    beside = [
        dataclasses.replace(
            world,
            name=f"{world.name} + stance_overlap(eta=0.1)",
            kind="beside",
            effects={**world.effects, hidden.OVERLAP[0]: hidden.OVERLAP[1]},
        )
        for world in first
    ]
    return [*outside, *(hidden.Case(world, 900 + i) for i, world in enumerate(beside))]


def run(case: hidden.Case) -> Left:
    """Discover, then add what is offered by ``compare`` and look."""
    with threadpool_limits(1):
        cells = cells_of(case.world.trials(case.seed, noise=case.noise))
        found = discover(cells, CATALOGUE, max_effects=1)
        floor, base = found.noise_floor_m_s, found.steps[0].cv_rmse_m_s
        left = found.residual
        if left is None:
            return Left(case, found.verdict.status, "–", found.steps[0].lack_of_fit_p, (base / floor,) * 2)
        last = compare(cells, catalogue(formulas=[left.formula]), [*left.effects, left.name])[-1]
        words = left.sentence.split(" (relative)")[0].split(" (body weights)")[0]
        ratios = (base / floor, last.cv_rmse_m_s / floor)
    return Left(case, found.verdict.status, words, last.lack_of_fit_p, ratios)


def report(all_left: Sequence[Left]) -> str:
    """The section of the report, in Markdown."""
    asked = [one for one in all_left if one.status == "unexplained"]
    lines = [
        "# What is left where nothing of the catalogue fits",
        "",
        f"{len(all_left)} worlds of the virtual lab with an effect outside the catalogue, {len(hidden.PHI)} φ × "
        f"{len(hidden.OMEGA)} ω × 3 trials; `discover` with single effects, then the formula it offers added as "
        "`compare --effect` does. Repaired: what remains is within the scatter of replicates, and the error out of "
        "sample is at most 1.10 × the noise floor.",
        "",
        f"Unexplained: {len(asked)} of {len(all_left)}; of these a formula repairs "
        f"{sum(one.repaired for one in asked)}, does not repair {sum(not one.repaired for one in asked)}.",
        "",
        "| world | noise | verdict | what is left | repaired | lack of fit p | error / noise floor: base, with it |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in all_left:
        repaired = ("yes" if one.repaired else "no") if one.status == "unexplained" else ""
        errors = f"{one.over_floor[0]:.2f}, {one.over_floor[1]:.2f}"
        cells = [one.case.world.name, f"{one.case.noise:g}", one.status, one.said, repaired, f"{one.p:.2g}", errors]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def sample() -> list[Figure]:
    """Every so many of them."""
    with ProcessPoolExecutor() as pool:
        found = [one for one in pool.map(run, cases()[::EVERY]) if one.status == "unexplained"]
    return share("misfit removed by the formula offered", "unexplained", [o.repaired for o in found], "≥ 50 %")


def main() -> str:
    """Run every world; the section of the report, in Markdown."""
    with ProcessPoolExecutor() as pool:
        tasks = cases()
        return report(list(tqdm(pool.map(run, tasks), total=len(tasks))))


if __name__ == "__main__":
    print(main())
