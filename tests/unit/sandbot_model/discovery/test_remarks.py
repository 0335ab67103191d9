"""What a verdict adds for its reader: that nearly all trials swam, where an adequate model of walking means little."""

from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.remarks import too_few_walked, unknown_response_time
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.goodness import Estimate
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}


TOLD = "so walking is hardly tested and Δt not known: run lower ω or higher φ"


def test_where_all_trials_swam_an_adequate_model_is_hardly_tested(drawn):
    cells = cells_of(drawn(seed=1, formulas=["weak: strength: k*0.7"]))
    verdict = discover(cells, EFFECTS, max_effects=0).verdict
    assert verdict.status == "adequate"
    assert f"all 35 conditions swam, {TOLD}" in verdict.remarks


@pytest.mark.parametrize(("stderr", "said"), [(np.inf, f"only 2 of 35 conditions walked, {TOLD}"), (0.01, "")])
def test_a_few_that_walked_are_too_few_if_they_do_not_determine_delta_t(drawn, stderr, said):
    cells = cells_of(drawn(seed=1, formulas=["weak: strength: k*0.8"]))
    base = SimpleNamespace(cells=cells, parameters={"delta_t_s": Estimate(0.4, stderr)})
    assert too_few_walked(base) == said


def test_where_enough_walked_or_all_at_one_frequency_that_is_not_said(drawn):
    for omega in ((4, 8, 12, 16, 20, 24, 30), (24,)):
        assert too_few_walked(fit(model_of("simple", (), EFFECTS), cells_of(drawn(seed=1, omega=omega)))) == ""


@pytest.mark.parametrize(
    ("omega", "stderr", "said"),
    [
        ((8, 16, 24), 0.3, "before you rely on it: walk at more values of ω"),
        ((8, 16, 24), np.inf, "before you rely on it: walk at more values of ω"),
        ((24,), np.nan, "before you rely on it: trials at one ω can't test Δt: run others (next trials)"),
        # Control.
        ((8, 16, 24), 0.05, ""),
    ],
)
def test_a_claim_beside_a_delta_t_that_is_not_known_says_so(drawn, omega, stderr, said):
    named = SimpleNamespace(cells=cells_of(drawn(seed=1, omega=omega)), parameters={"delta_t_s": Estimate(0.4, stderr)})
    found = unknown_response_time(named)
    assert found.endswith(said)
    assert bool(found) == bool(said)
