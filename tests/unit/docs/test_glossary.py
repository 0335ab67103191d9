"""docs/glossary.md has the words of the output, with the numbers of the code."""

import re
from pathlib import Path

import pytest

from sandbot_model.design.look import BLOCK
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.fitting.goodness import FAIL_Z

PAGE = (Path(__file__).parents[3] / "docs" / "glossary.md").read_text(encoding="utf-8")
MEANINGS = dict(re.findall(r"^\| ([^|]+) \| ([^|]+) \|$", PAGE, flags=re.M))
TERMS = [term for line in MEANINGS for term in line.split(", ")]
SAID = (
    "ΔBIC",
    "Δχ²",
    "weight",
    "z",
    "nuisance",
    "batch",
    "block",
    "sentinel",
    "variant",
    "partial",
    "untested",
    "held",
)
SAID += ("pure error", "lack of fit", "out of sample", "noise floor", "gap", "α", "e-value", "claim", "look", "limit")


@pytest.mark.parametrize("term", SAID)
def test_what_is_printed_is_explained(term):
    assert TERMS.count(term) == 1


@pytest.mark.parametrize(
    ("term", "number"),
    [
        ("claim", f"{DEFAULT.claim:g}"),
        ("BIC, ΔBIC", f"difference of {DEFAULT.clearly:g}"),
        ("lack of fit", f"below {DEFAULT.lack_of_fit:g}"),
        ("z", f"beyond {FAIL_Z:g}"),
        ("block", {6: "six trials"}[BLOCK]),
    ],
)
def test_numbers_are_the_codes(term, number):
    assert number in MEANINGS[term]
