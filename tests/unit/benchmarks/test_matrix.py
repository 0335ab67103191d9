"""What `make bench` asks of a matrix of campaigns."""

import dataclasses
import json

from _figures import share
from _matrix import Matrix


@dataclasses.dataclass(frozen=True)
class Case:
    row: str
    seed: int


def analyse(case):
    return {**dataclasses.asdict(case), "right": case.seed == 0}


def matrix(out):
    cases = [Case("row", seed) for seed in range(2)]
    return Matrix(
        analyse,
        lambda: cases[:1],
        lambda: cases,
        out,
        lambda results: f"{len(results)} campaigns",
        lambda results: share("right", "campaigns", [one["right"] for one in results], "≥ 95 %"),
    )


def test_a_report_has_its_figures_and_a_sample_has_its_own(tmp_path):
    """What is known is not run again, so that both are of what the file holds."""
    out = tmp_path / "out.jsonl"
    out.write_text("".join(json.dumps({"row": "row", "seed": seed, "right": False}) + "\n" for seed in range(2)))
    of_two = matrix(out)
    assert of_two.figures() == []
    assert of_two.main() == "2 campaigns"
    assert [(one.of, one.value) for one in of_two.figures()] == [("0 of 2 campaigns", 0.0)]
    assert [(one.of, one.value) for one in of_two.sample()] == [("1 of 1 campaigns", 100.0)]
