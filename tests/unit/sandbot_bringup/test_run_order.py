"""Campaigns are run in random blocks, the same seed gives the same order, and a campaign that grows keeps it."""

import dataclasses
import itertools
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.plan import plan_of, trials_of, with_next_trials
from sandbot_bringup.tools.campaign import describe

PLAN = {"name": "a", "phi": [0.58, 0.6, 0.62], "omega_rad_s": [4, 8, 12], "replicates": 3, "gait": "UNIFORM"}


def run_of(**keys):
    return sorted(trials_of(plan_of({**PLAN, **keys}, "plan")), key=lambda trial: trial.run_order)


def conditions(trials):
    return [(trial.phi, trial.omega_rad_s) for trial in trials]


def test_a_block_holds_every_condition_once_and_begins_with_the_sentinel():
    run = run_of()
    assert [trial.run_order for trial in run] == list(range(1, 28))
    for number in range(3):
        block = run[9 * number : 9 * number + 9]
        assert {trial.batch for trial in block} == {f"block{number + 1}"}
        assert len(set(conditions(block))) == 9
        assert conditions(block)[0] == (0.6, 8)
        assert conditions(block)[1:] != sorted(conditions(block)[1:])


def test_as_listed_is_as_listed():
    run = run_of(order="as_listed")
    assert run == trials_of(plan_of({**PLAN, "order": "as_listed"}, "plan"))
    assert conditions(run) == [one for one in itertools.product(PLAN["phi"], PLAN["omega_rad_s"]) for _ in range(3)]
    assert {trial.batch for trial in run} == {""}


def test_the_seed_gives_the_order_and_the_order_changes_no_trial():
    assert run_of(seed=3) == run_of(seed=3)
    assert conditions(run_of(seed=3)) != conditions(run_of(seed=4))
    chance = [{(t.trial_id, t.seed, t.phi) for t in run_of(order=order)} for order in ("randomised", "as_listed")]
    assert chance[0] == chance[1]


def test_more_sentinels_come_at_their_distance():
    run = run_of(sentinel=5)
    assert len(run) == 27 + 5
    added = [trial for trial in run if trial.replicate > 3]
    assert set(conditions(added)) == {(0.6, 8)}
    assert [trial.run_order for trial in added] == [6, 12, 18, 24, 30]
    assert {trial.trial_id for trial in run_of()} < {trial.trial_id for trial in run}
    assert run[-1].occasion.progress == 1.0


def test_a_campaign_that_grows_keeps_its_order(tmp_path):
    plan = plan_of(PLAN, "plan")
    for number in (1, 2):
        asked = [{"phi": 0.61, "omega_rad_s": 10.0 + number}, {"phi": 0.63, "omega_rad_s": 10.0 + number}]
        (tmp_path / "next.json").write_text(json.dumps({"next_trials": asked}))
        grown = with_next_trials(plan, tmp_path / "next.json")
        assert trials_of(grown)[: len(trials_of(plan))] == trials_of(plan)
        added = sorted(trials_of(grown)[len(trials_of(plan)) :], key=lambda trial: trial.run_order)
        assert len(added) == 6
        assert [len(set(conditions(added[i : i + 2]))) for i in (0, 2, 4)] == [2, 2, 2]
        assert len({trial.batch for trial in trials_of(grown)}) == 3 + 3 * number
        assert with_next_trials(grown, tmp_path / "next.json") == grown
        plan = grown


@given(
    phis=st.integers(1, 4),
    omegas=st.integers(1, 4),
    replicates=st.integers(1, 4),
    sentinel=st.integers(0, 9),
    extra=st.lists(st.integers(1, 3), max_size=3),
    order=st.sampled_from(["randomised", "as_listed"]),
)
def test_every_trial_is_run_once(phis, omegas, replicates, sentinel, extra, order):
    run = run_of(
        phi=[0.58 + 0.01 * i for i in range(phis)],
        omega_rad_s=list(range(4, 4 + omegas)),
        replicates=replicates,
        sentinel=sentinel,
        order=order,
        extra_trials=[{"phi": 0.6, "omega_rad_s": 5, "replicates": count} for count in extra],
    )
    grid = phis * omegas * replicates
    assert len({trial.trial_id for trial in run}) == len(run)
    assert len(run) == grid + ((grid - 1) // sentinel if sentinel else 0) + sum(extra)
    assert [trial.run_order for trial in run] == list(range(1, len(run) + 1))


def test_a_dry_run_tells_the_order():
    plan = plan_of(PLAN, "plan")
    lines = describe(plan, run_of()).splitlines()
    assert [line.split()[2] for line in lines[3:]] == [trial.trial_id for trial in run_of()]
    assert "order randomised, seed 1" in lines[2]


@pytest.mark.parametrize("keys", [{"order": "sorted"}, {"sentinel": -1}])
def test_refusals(keys):
    with pytest.raises(Exception, match=next(iter(keys))):
        plan_of({**PLAN, **keys}, "plan")


def test_the_plan_of_another_order_is_another_plan():
    plan = plan_of(PLAN, "plan")
    assert dataclasses.replace(plan, order="as_listed") != plan
