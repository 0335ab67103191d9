"""A slip in a condition of one trial refuses no model; what several trials say, or several conditions, does."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.repeats import SLIP_OR_MISS
from sandbot_model.physics.catalogue import catalogue

FEW = {name: catalogue()[name] for name in ("stance_overlap", "swimming_thrust")}
OBSERVABLES = ("speed_m_s", "lift_m", "peak_speed_m_s", "first_step_m")


def slipped(trials, alone=True, conditions=1):
    """The first conditions of the closest ground: trials that fall short of where they should come to, of one trial
    each where they are ``alone``."""
    close = trials.phi > 0.625
    slow = np.unique(trials.omega_rad_s)[:conditions]
    there = close & np.isin(trials.omega_rad_s, slow)
    values = {name: np.array(getattr(trials, name)) for name in OBSERVABLES}
    for name in ("speed_m_s", "first_step_m"):
        values[name][there] *= 0.6
    if alone:
        for name in OBSERVABLES:
            values[name][there & (trials.replicate > trials.replicate.min())] = np.nan
    return replace(trials, **values)


def test_a_slip_that_no_replicate_shows_refuses_no_model(drawn):
    found = discover(cells_of(slipped(drawn(seed=5))), FEW, max_effects=1)
    assert found.verdict.status == "adequate"
    assert "ω 4 rad/s, which is alone in its condition and far off: repeat it" in found.verdict.because
    assert (found.next_trials[0].omega_rad_s, found.next_trials[0].separates) == (4.0, SLIP_OR_MISS)


@pytest.mark.whole
def test_an_effect_is_named_beside_such_a_slip(drawn):
    found = discover(cells_of(slipped(drawn(("stance_overlap",), seed=5))), FEW, max_effects=1)
    assert found.headline == "identified: stance_overlap"
    assert "repeat it" in found.verdict.because


@pytest.mark.parametrize("how", [pytest.param({"alone": False}, marks=pytest.mark.whole), {"conditions": 3}])
def test_what_replicates_or_several_conditions_say_is_no_slip(drawn, how):
    found = discover(cells_of(slipped(drawn(seed=5), **how)), FEW, max_effects=1)
    assert found.verdict.status == "unexplained"


@pytest.mark.whole
def test_where_none_may_be_left_out_none_is(drawn):
    cells = cells_of(slipped(drawn(seed=5)))
    assert (
        discover(cells, FEW, max_effects=1, criteria=replace(DEFAULT, lone_trials=1e-9)).verdict.status == "unexplained"
    )
