"""Policy of the verdict in one place: what it refuses, and that it is obeyed."""

import dataclasses

import pytest

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.criteria import DEFAULT, Criteria, of_bed
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.verdict import judge
from sandbot_model.physics.effects import CATALOGUE


@pytest.mark.parametrize(
    ("name", "value"), [("lack_of_fit", 1.5), ("claim", 0.0), ("one_cell", -0.1), ("clearly", float("nan"))]
)
def test_a_value_that_means_nothing_is_refused(name, value):
    with pytest.raises(InputError, match=f"criteria: {name} is"):
        dataclasses.replace(DEFAULT, **{name: value})


def test_what_is_known_of_a_bed_takes_the_place_of_the_usual_priors():
    assert of_bed(None, None) == DEFAULT
    assert of_bed(0.003, None) == dataclasses.replace(DEFAULT, bed_scatter=0.003)
    assert of_bed(None, 0.01) == dataclasses.replace(DEFAULT, drift=0.01)
    for value in (0.0, -0.01, 0.7, float("nan")):
        with pytest.raises(InputError, match=r"--bed-scatter .*: a fraction above 0 and up to 0\.3"):
            of_bed(value, None)
        with pytest.raises(InputError, match="--bed-drift"):
            of_bed(None, value)


def test_other_criteria_change_the_verdict(drawn):
    overlap = {effect.identifier: effect for effect in CATALOGUE if effect.identifier == "stance_overlap"}
    cells = cells_of(drawn(("stance_overlap",), seed=6, levels=3))
    usual = discover(cells, overlap, max_effects=1)
    fits = {fit.effects: fit for fit in usual.fits}
    assert usual.verdict.status == judge(fits).status == "identified"
    assert judge(fits, Criteria(claim=1e4)).status == "unexplained"
    lenient = Criteria(claim=1e4, lack_of_fit=1e-30, lack_of_fit_of_one=1e-30)
    # A test that refuses nothing tests nothing, unless the caller says that any miss may pass.
    assert discover(cells, overlap, max_effects=1, criteria=lenient).verdict.status == "untested"
    lenient = dataclasses.replace(lenient, gross=1e30)
    found = discover(cells, overlap, max_effects=1, criteria=lenient)
    assert (found.verdict.status, found.criteria) == ("adequate", lenient)
