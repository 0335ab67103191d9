"""What nobody said is assumed in so many words, and another gait that would change a verdict is named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_common.accuracy import USUAL
from sandbot_common.robot import SANDBOT
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import other_gait
from sandbot_model.discovery.assumed import assumed
from sandbot_model.discovery.criteria import DEFAULT, of_bed
from sandbot_model.discovery.discover import discover

GIVEN = {"robot": SANDBOT, "accuracy": USUAL}


@pytest.fixture(scope="module")
def trials(drawn):
    return drawn((), levels=2, omega=(8, 14))


@pytest.fixture(scope="module")
def found(trials):
    return discover(cells_of(trials), {}, max_effects=0)


@pytest.mark.parametrize(
    ("given", "criteria", "named"),
    [
        (
            {"robot": None, "accuracy": None, "gait": ""},
            DEFAULT,
            ["robot", "gait not given", "cameras", "bed", "order of trials"],
        ),
        ({"robot": None, "accuracy": None, "gait": ""}, None, ["robot", "gait not given", "cameras"]),
        (GIVEN | {"gait": "HGCS"}, of_bed(0.005, None), ["order of trials"]),
    ],
    ids=["a verdict, nothing given", "without a verdict", "all but the order given"],
)
def test_every_assumption_is_named_and_nothing_that_is_given(trials, given, criteria, named):
    some = replace(trials, **given | {"gait": np.full(len(trials), given["gait"])})
    assert [line.split(":")[0] for line in assumed(some, cells_of(some), criteria)] == named


def test_where_the_order_is_given_a_drift_is_fitted_and_none_is_assumed(trials):
    some = replace(trials, **GIVEN, gait=np.full(len(trials), "HGCS"), run_order=np.arange(float(len(trials))))
    assert assumed(some, cells_of(some), of_bed(0.005, None)) == ()


@pytest.mark.parametrize(("fails_at", "gait"), [("UNIFORM", ""), ("UNIFORM", "SGCS"), ("none", "")])
def test_a_gait_that_would_change_the_verdict_is_named_where_none_is_given(monkeypatch, trials, found, fails_at, gait):
    """Controls: the gait is given; no other gait changes anything."""

    def fitted(cells, before, _criteria):
        p = 1e-6 if set(cells.gait) == {fails_at} else before.lack_of_fit_p
        return SimpleNamespace(lack_of_fit_p=p, goodness=SimpleNamespace(lack_of_fit={}))

    monkeypatch.setattr(other_gait, "_fitted_to", fitted)
    some = replace(trials, gait=np.full(len(trials), gait))
    tried = other_gait.tried_with_other_gaits(found, some)
    changes = fails_at == "UNIFORM" and not gait
    assert (tried is found) != changes
    told = "if the gait was UNIFORM, the simple model fails (lack of fit p = 1e-06); a gait column would settle this"
    assert tried.verdict.because.endswith(told) == changes
    assert "HGCS" not in tried.verdict.because


def test_the_models_of_a_verdict_are_fitted_to_the_other_gaits_cells(trials, found):
    """The clock as given fits as before, its own gait being what was assumed."""
    again = other_gait._fitted_to(found.cells, found.fit, DEFAULT)
    assert again.deviance == pytest.approx(found.fit.deviance, abs=0.1)
