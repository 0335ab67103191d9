import json
import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.plan import Plan, read_plan, trials_of
from sandbot_bringup.queue import Queue, State
from sandbot_common.errors import InputError

PLAN = Plan("p", (0.6, 0.61), (8.0, 12.0), replicates=2, gait="UNIFORM")


def order(queue):
    """The queue run to its end."""
    names = []
    while (trial := queue.next()) is not None:
        names.append(trial.trial_id)
        queue.begin(names[-1])
        queue.finish(names[-1], 10.0, {})
    return names


def planned(plan=PLAN):
    return [one.trial_id for one in sorted(trials_of(plan), key=lambda one: one.run_order)]


def test_it_runs_in_the_plan_s_order_what_has_no_bag():
    assert order(Queue(PLAN, ())) == planned()
    done = planned()[2:4]
    assert order(Queue(PLAN, done)) == [name for name in planned() if name not in done]


def test_a_stopped_trial_keeps_its_turn_and_a_failed_one_does_not_run_again():
    queue = Queue(PLAN, ())
    first, second, *_ = planned()
    queue.begin(first)
    queue.put_back(first, "stopped")
    assert queue.next().trial_id == first
    assert queue.entries[first].reason == "stopped"
    queue.begin(first)
    assert queue.entries[first].reason == ""
    assert (queue.waiting, queue.measured) == (len(planned()) - 1, False)
    queue.fail(first, "no marker")
    assert queue.next().trial_id == second
    assert (queue.failed, queue.measured) == ({first: "no marker"}, False)
    queue.finish(second, 10.0, {})
    assert (queue.waiting, queue.measured) == (len(planned()) - 2, True)


def test_what_failed_or_was_skipped_is_repeated_at_the_end():
    queue = Queue(PLAN, ())
    first, second, *rest = planned()
    queue.fail(first, "no marker")
    queue.skip(second)
    assert queue.skipped == [second]
    queue.repeat(second)
    assert queue.skipped == []
    queue.repeat(first)
    assert order(queue) == [*rest, second, first]
    # Nor is it shown as skipped any longer, now or in a resumed campaign.
    events = [{"do": do, "trial_id": second} for do in ("skip", "repeat")]
    assert [one.entries[second].reason for one in (queue, Queue(PLAN, (), events), Queue(PLAN, (), events[:1]))] == [
        "", "", "skipped by the operator",
    ]  # fmt: skip


def test_a_finished_trial_is_neither_skipped_nor_replaced():
    queue = Queue(PLAN, ())
    first, second, *rest = planned()
    queue.finish(first, 10.0, {"speed_m_s": 0.1})
    with pytest.raises(InputError, match="is done; only a trial that waits or failed can be skipped"):
        queue.skip(first)
    queue.repeat(first)
    new = first[:-1] + "3"  # replicates 1 and 2 are in the plan
    assert order(queue) == [second, *rest, new]
    assert queue.entries[first].measured == {"speed_m_s": 0.1}


def test_what_runs_or_waits_is_not_repeated_and_what_runs_not_skipped():
    queue = Queue(PLAN, ())
    first, second, *_ = planned()
    queue.begin(first)
    for change, name in ((queue.skip, first), (queue.repeat, first), (queue.repeat, second)):
        with pytest.raises(InputError, match=r"is (running|waiting); only"):
            change(name)
    with pytest.raises(InputError, match="there is no trial 'x'"):
        queue.skip("x")


def test_an_added_condition_comes_last_with_a_gait_of_its_own_and_is_stored_in_the_plan(tmp_path):
    folder = CampaignFolder(tmp_path / "c")
    folder.adopt(PLAN, {})
    queue = Queue(PLAN, ())
    queue.add({"phi": 0.605, "omega_rad_s": 10, "replicates": 2, "gait": "SGCS"})
    queue.add({"phi": 0.62, "omega_rad_s": 8.0, "replicates": 1, "gait": "UNIFORM"})  # the plan's own
    folder.adopt(queue.plan, {})
    resumed = Queue(folder.grown(PLAN), planned())
    added = order(resumed)
    assert order(queue) == [*planned(), *added]
    assert set(added[:2]) == {"phi0.6050_w10.000_SGCS_r01", "phi0.6050_w10.000_SGCS_r02"}
    assert added[2:] == ["phi0.6200_w08.000_r01"]
    trial = resumed.entries[added[0]].trial
    assert read_plan(folder.plan_file).for_trial(trial).gait == "SGCS"
    assert PLAN.for_trial(resumed.entries[added[2]].trial) == PLAN


@pytest.mark.parametrize(
    ("condition", "why"),
    [
        ({"phi": 0.7, "omega_rad_s": 8}, "phi"),
        ({"phi": 0.572, "omega_rad_s": 8}, "can't be reached"),
        ({"phi": 0.6, "omega_rad_s": 0}, "omega_rad_s"),
        ({"phi": 0.6}, "omega_rad_s"),
        ({"phi": 0.6, "omega_rad_s": 8, "gait": "GALLOP"}, "GALLOP"),
        ({"phi": 0.6, "omega_rad_s": 8, "replicates": 0}, "replicates"),
        ({"phi": 0.6, "omega_rad_s": 8, "speed": 1}, "speed"),
    ],
)
def test_a_condition_that_can_t_be_run_is_refused_and_changes_nothing(condition, why):
    queue = Queue(PLAN, ())
    with pytest.raises(InputError, match=why):
        queue.add(condition)
    assert order(queue) == planned()


def test_a_resumed_campaign_leaves_out_what_was_skipped_and_runs_again_what_failed():
    first, second, third, fourth, *_ = planned()
    events = [
        {"do": "done", "trial_id": first, "seconds": 12.5, "measured": {"speed_m_s": 0.1}},
        {"do": "failed", "trial_id": second, "reason": "no marker"},
        {"do": "skip", "trial_id": third},
        {"do": "skip", "trial_id": fourth},
        {"do": "repeat", "trial_id": fourth},
        {"do": "skip", "trial_id": "of another plan"},
    ]
    queue = Queue(PLAN, [first], events)
    states = [queue.entries[name].state for name in (first, second, third, fourth)]
    assert states == [State.DONE, State.WAITING, State.SKIPPED, State.WAITING]
    assert queue.entries[second].reason == "no marker"
    assert queue.entries[first].seconds == 12.5
    # Its bag was taken away meanwhile: it is not done whatever the journal says.
    assert Queue(PLAN, [], events).entries[first].state is State.WAITING


def test_the_time_left_is_that_of_trials_like_those_done():
    queue = Queue(PLAN, ())
    assert math.isnan(queue.left_s())
    walks = [PLAN.duration_s(one.omega_rad_s) + PLAN.standing_s for one in trials_of(PLAN)]
    for trial in trials_of(PLAN)[:3]:
        queue.finish(trial.trial_id, 20.0 + PLAN.duration_s(trial.omega_rad_s) + PLAN.standing_s, {})
    assert queue.left_s() == pytest.approx(5 * 20.0 + sum(walks[3:]))
    queue.skip(trials_of(PLAN)[7].trial_id)
    assert queue.left_s() == pytest.approx(4 * 20.0 + sum(walks[3:7]))


@given(
    st.lists(st.tuples(st.sampled_from(["begin", "finish", "fail", "put_back", "skip", "repeat"]), st.integers(0, 7)))
)
def test_whatever_the_operator_does_every_trial_is_there_once_and_what_is_done_stays_done(words):
    queue, names, done = Queue(PLAN, ()), planned(), set()
    for word, index in words:
        name = names[index]
        if word in ("skip", "repeat"):
            with suppress(InputError):
                getattr(queue, word)(name)
        elif name not in done:
            more = {"finish": (1.0, {}), "fail": ("x",), "put_back": ("x",)}.get(word, ())
            getattr(queue, word)(name, *more)
            done |= {name} if word == "finish" else set()
        rows = [row["trial_id"] for row in queue.rows()]
        assert len(rows) == len(set(rows)) >= len(names)
        assert all(queue.entries[one].state is State.DONE for one in done)
    json.dumps(queue.rows(), allow_nan=False)
