"""The harness of the benchmark of other forms: every form acts, and what counts as what."""

from types import SimpleNamespace

import numpy as np
import pytest

import _drawn
import variants
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable


@pytest.mark.parametrize(
    ("family", "status", "sets", "said"),
    [
        ("stance_overlap", "identified", [["stance_overlap"]], "identified"),
        ("stance_overlap", "partial", [["stance_overlap"]], "partial"),
        ("stance_overlap", "ambiguous", [["dilation"], ["stance_overlap"]], "ambiguous"),
        ("stance_overlap", "identified", [["stance_overlap", "dilation"]], "half"),
        ("stance_overlap", "partial", [["dilation"]], "false claim"),
        ("cable_drag", "identified", [["leg_slip"]], "identified"),
        ("stance_overlap", "identified", [["leg_slip"]], "false claim"),
        ("stance_overlap", "adequate", [], "adequate"),
        ("stance_overlap", "unexplained", [], "unexplained"),
        (variants.OUTSIDE, "partial", [["stance_overlap"]], "partial"),
    ],
)
def test_a_verdict_falls_in_its_column(family, status, sets, said):
    verdict = SimpleNamespace(status=status, alternatives=sets, effects=sets[0] if sets else [])
    assert variants.outcome(family, SimpleNamespace(verdict=verdict)) == said
    assert said in variants.OUTCOMES


def observables(form):
    trials = variants.campaign(form, 3)
    return np.stack([getattr(trials, one.column) for one in Observable], axis=-1) / _drawn.NOISE


FAINT = {
    "prism of grains under the chord, as deep as the leg": 0.9,
    "recorder drops frames once its buffer is full, after eight seconds": 2,
    "thrust lost with the logarithm of frequency": 2,
    "kinetic energy of the walking body is taken off what the leg must give": 1.2,
    "swimming belly is held up by denser ground": 2,
}
"""Forms of an honest size that moves hardly anything."""


@pytest.mark.whole
def test_every_form_is_of_a_family_or_of_none_and_moves_something():
    without = observables(variants.Form("none", "nothing acts", {}))
    for form in variants.FORMS:
        assert form.family in {*catalogue(), variants.OUTSIDE}
        # The same noise in both.
        assert np.nanmax(np.abs(observables(form) - without)) > FAINT.get(form.name, 3), form


@pytest.mark.parametrize(("name", "same"), [("hold is Coulomb friction", True), ("slip falls linearly", False)])
def test_what_can_t_be_told_from_what_is_named_is_no_false_claim(name, same):
    """A constant share of each step with the peak spared is an overlap; one that falls with depth is not."""
    form = next(one for one in variants.FORMS if one.name.startswith(name))
    cells = cells_of(variants.campaign(form, 3))
    overlap = fit(model_of("simple", ("stance_overlap",), catalogue()), cells)
    assert (variants.missed(form, cells, [overlap]) < variants.TOLD) is same
