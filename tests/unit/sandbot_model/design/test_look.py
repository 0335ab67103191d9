"""Looks at campaigns of the virtual lab: when they are enough, and what is run next if not."""

import math
from functools import cache

import pytest
from worlds import BY_NAME, EFFECTS

from sandbot_lab.direct import direct_trials
from sandbot_model.data.conditions import cells_of
from sandbot_model.design.look import BLOCK, ENOUGH, REFUSED, Plan, look
from sandbot_model.design.start import start
from sandbot_record.trials.table import Row, from_rows

PHI = [0.58, 0.5977, 0.6153, 0.633]
OMEGA = [4.0, 8.0, 12.0, 16.0, 24.0]
CONDITIONS = [(phi, omega) for phi in PHI for omega in OMEGA]
PLAN = Plan(CONDITIONS, lambda _: 30.0, 3)

pytestmark = pytest.mark.slow


@cache
def seen(name, replicates=3, whole=True, number=1, seed=3, size=1.0):
    world = BY_NAME[name]
    conditions = CONDITIONS if whole else start(PHI, OMEGA)
    rows = [
        row
        for phi, omega in conditions
        for row in direct_trials(world.world(size), [phi], [omega], world.gait, replicates, seed)
    ]
    cells = cells_of(from_rows([Row(**row) for row in rows]))
    return look(cells, EFFECTS, PLAN, number=number, max_effects=1)


def test_a_strong_effect_is_found_and_the_rest_excluded():
    found = seen("stance_overlap(eta=0.2)")
    assert (found.found.verdict.status, found.found.verdict.effects) == ("identified", ("stance_overlap",))
    excluded = {one.effect for one in found.possible if one.excluded}
    assert {"disturbed_ground", "exact_vertical_acceleration", "belly_coast"} <= excluded
    assert found.stop == ENOUGH or set(found.within_reach).isdisjoint(excluded)


def test_nothing_missing_ends_it_too():
    found = seen("null")
    assert found.found.verdict.status == "adequate"
    assert found.stop == ENOUGH
    assert not found.block


def test_ground_of_no_known_kind_is_refused_for_good():
    found = seen("x_resonance(loss=0.3, omega_0_rad_s=12, width_rad_s=2)")
    assert found.found.verdict.status in ("unexplained", "partial")
    assert found.stop == REFUSED
    assert not found.block


@pytest.mark.parametrize(("seed", "leans"), [(1, True), pytest.param(3, False, marks=pytest.mark.whole)])
def test_what_the_data_lean_to_is_not_out_of_reach(seed, leans):
    """The plan would hardly exclude an inertial drag; control: data that do not lean to it."""
    found = seen("inertial_drag(lambda_=1)", seed=seed, size=0.5)
    assert found.found.verdict.status == "adequate"
    drag = next(one for one in found.possible if one.effect == "inertial_drag")
    assert drag.favoured == leans
    assert ("inertial_drag" in found.within_reach, found.stop == ENOUGH) == (leans, not leans)


def test_too_little_goes_on_with_a_block_of_the_plan():
    found = seen("null", replicates=2, whole=False)
    assert not found.stop
    assert len(found.block) == BLOCK
    assert {(one.phi, one.omega_rad_s) for one in found.block} <= set(CONDITIONS)
    assert all(one.because for one in found.block)
    assert found.within_reach
    assert "next: φ" in str(found)


def test_it_is_plain_data():
    content = seen("null", replicates=2, whole=False).to_dict()
    assert content["status"] == "adequate"
    assert len(content["next"]) == BLOCK
    reachable = [one for one in content["possible"] if one["within_reach"]]
    assert reachable
    assert not any(one["excluded"] for one in reachable)
    assert all(math.isfinite(one["e_value_against"]) for one in content["possible"])
    assert {one["phi"] for one in content["rivals"]} == {one["phi"] for one in content["next"]}
    assert len({one["explanation"] for one in content["rivals"]}) > 1


def test_nothing_is_drawn_where_nothing_is_asked():
    assert seen("null").to_dict()["rivals"] == []
