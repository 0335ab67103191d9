"""A campaign until a verdict, but for the looks themselves (tests/unit/sandbot_model/design, tests/integration)."""

import json
from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from sandbot_bringup import until
from sandbot_bringup.folder import CampaignFolder, sample_trial
from sandbot_bringup.plan import plan_of, trials_of
from sandbot_common.errors import InputError
from sandbot_record.bags import metadata

GRID = {"name": "thinking", "phi": [0.58, 0.6, 0.633], "omega_rad_s": [8, 16, 24, 30], "until": "verdict"}


def plan(**more):
    return plan_of({**GRID, **more}, "plan.yaml")


def entry(**more):
    return {"look": 1, "planned": 16, "finished": 0, "text": "so far", "stop": "", "next": [], **more}


@dataclass(frozen=True)
class Found:
    """What a look finds, as far as ``until`` reads it."""

    stop: str
    block: tuple
    found = SimpleNamespace(to_dict=dict)

    def to_dict(self):
        return {"stop": self.stop, "next": list(self.block)}


ASKED = {"phi": 0.6, "omega_rad_s": 16.0, "because": "a and b differ there by 2.0 sd in the mean speed"}


def test_the_grid_says_where_trials_may_be_and_none_is_run_for_being_on_it():
    assert trials_of(plan()) == []
    begun = until.with_start(plan())
    trials = trials_of(begun)
    conditions = {(one.phi, one.omega_rad_s) for one in trials}
    assert len(trials) == until.REPLICATES * len(conditions) < 3 * 12
    assert {phi for phi, _ in conditions} == {0.58, 0.6, 0.633}
    assert {one.because for one in trials} == {until.START}
    assert {one.batch for one in trials} == {"block1", "block2"}


def test_it_begins_once():
    begun = until.with_start(plan())
    assert until.with_start(begun) == begun
    reworded = [{**extra, "because": "spread over the plan"} for extra in begun.extra_trials]
    again = replace(begun, extra_trials=tuple(reworded))
    assert until.with_start(again) == again


def test_conditions_pinned_once_or_in_another_gait_are_no_start():
    starting = until.with_start(plan()).extra_trials
    for change in ({"replicates": 1}, {"gait": "SGCS"}):
        pinned = plan(gait="UNIFORM", extra_trials=[{**extra, **change} for extra in starting])
        assert len(until.with_start(pinned).extra_trials) == 2 * len(starting)


@pytest.mark.parametrize(("stop", "budget", "has"), [("", 16, {"budget": 16}), ("", 30, {}), ("enough", 16, {})])
def test_a_look_that_stops_for_its_budget_says_which(tmp_path, monkeypatch, stop, budget, has):
    found = Found(stop, ({"phi": 0.6, "omega_rad_s": 16.0},))
    monkeypatch.setattr("sandbot_model.design.look.look", lambda *_, **__: found)
    monkeypatch.setattr("sandbot_model.data.conditions.cells_of", lambda _: None)
    monkeypatch.setattr("sandbot_record.trials.from_bags.campaign", lambda *_: SimpleNamespace(trials=None))
    monkeypatch.setattr(until, "_count_ok", lambda *_: 0)
    entry = until.decide(until.with_start(plan(budget=budget)), CampaignFolder(tmp_path))[1]
    assert {key: entry[key] for key in entry if key == "budget"} == has
    assert entry["stop"] == (stop or ("the budget of 16 trials is used up" if has else ""))
    assert len(entry["next"]) == (budget == 30)


def test_what_the_plan_pins_is_run_first():
    pinned = until.with_start(plan(extra_trials=[{"phi": 0.61, "omega_rad_s": 12}]))
    first = min(trials_of(pinned), key=lambda one: one.run_order)
    assert (first.phi, first.omega_rad_s) == (0.61, 12)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"budget": 5}, "budget: 5 trials are fewer than the 16"),
        ({"model": "fulll"}, "model: 'fulll' is not a base model"),
    ],
)
def test_what_can_give_no_verdict_is_refused(more, said):
    with pytest.raises(InputError, match=said):
        until.with_start(plan(**more))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"until": "", "budget": 5}, "budget: 5 without until"),
        ({"until": "", "alpha": 0.1}, "alpha: 0.1 without until"),
        ({"until": "", "bed_scatter": 0.01}, "bed_scatter: 0.01 without until"),
        ({"bed_drift": 0.7}, "bed_drift"),
        ({"sentinel": 5}, "sentinel: 5 with until"),
        ({"until": "noon"}, "until"),
        ({"alpha": 0.9}, "alpha"),
    ],
)
def test_what_would_be_ignored_or_is_no_choice_is_refused(more, said):
    with pytest.raises(InputError, match=said):
        plan(**more)


def test_a_look_that_was_taken_is_not_taken_again(tmp_path, monkeypatch):
    """Whoever resumes decides alike."""
    looks = []
    monkeypatch.setattr(until, "_look", lambda *_: looks.append(1) or {"text": "so far", "stop": "", "next": [ASKED]})
    folder, begun = CampaignFolder(tmp_path), until.with_start(plan())
    grown, first = until.decide(begun, folder)
    again, second = until.decide(begun, folder)
    assert (grown, first) == (again, second)
    assert len(looks) == 1
    new = trials_of(grown)[len(trials_of(begun)) :]
    assert [(one.phi, one.omega_rad_s, one.because) for one in new] == [(0.6, 16.0, ASKED["because"])]
    assert until.decide(grown, folder)[1]["look"] == 2


def test_what_was_measured_since_is_looked_at(tmp_path, monkeypatch):
    """A failed trial that was repeated, say: the plan is the same, and more is known."""
    monkeypatch.setattr(until, "_look", lambda *_: {"text": "so far", "stop": "", "next": [ASKED]})
    folder, begun = CampaignFolder(tmp_path), until.with_start(plan())
    assert until.decide(begun, folder)[1]["look"] == 1
    bag = folder.bag(trials_of(begun)[0])
    bag.mkdir(parents=True)
    metadata.write(bag, metadata.BagInfo())
    assert until.decide(begun, folder)[1]["look"] == 2


def test_what_stopped_for_its_budget_goes_on_with_a_larger_one(tmp_path, monkeypatch):
    spent = {"text": "all spent", "stop": "all spent", "next": [], "budget": 16}
    monkeypatch.setattr(until, "_look", lambda *_: spent)
    folder, begun = CampaignFolder(tmp_path), until.with_start(plan(budget=16))
    assert until.decide(begun, folder)[1]["look"] == until.decide(begun, folder)[1]["look"] == 1
    monkeypatch.setattr(until, "_look", lambda *_: {"text": "on", "stop": "", "next": [ASKED]})
    grown, entry = until.decide(replace(begun, budget=30), folder)
    assert (entry["look"], len(trials_of(grown))) == (2, 17)
    assert until.decide(replace(begun, budget=30), folder)[1] == entry


def test_what_stopped_with_a_verdict_needs_no_look_for_a_larger_budget(tmp_path, monkeypatch):
    monkeypatch.setattr(until, "_look", lambda *_: {"text": "enough", "stop": "enough", "next": []})
    folder, begun = CampaignFolder(tmp_path), until.with_start(plan(budget=16))
    assert until.decide(begun, folder)[1]["look"] == 1
    assert until.decide(replace(begun, budget=30), folder)[1]["look"] == 1


def test_a_trial_that_is_ok_since_is_looked_at(tmp_path, monkeypatch):
    """It had failed, and was run again: there are no more bags than before."""
    ok = [3]
    monkeypatch.setattr(until, "_count_ok", lambda *_: ok[0])
    monkeypatch.setattr(until, "_look", lambda *_: {"text": "so far", "stop": "enough", "next": []})
    folder, begun = CampaignFolder(tmp_path), until.with_start(plan())
    assert [until.decide(begun, folder)[1]["look"] for _ in range(2)] == [1, 1]
    ok[0] = 4
    assert until.decide(begun, folder)[1]["look"] == 2


def test_the_budget_holds_for_all_that_is_run(tmp_path):
    pinned = [{"phi": 0.61, "omega_rad_s": 12, "replicates": 4}]
    with pytest.raises(InputError, match="budget: 18 trials are fewer than the 20 it starts with"):
        until.with_start(plan(budget=18, extra_trials=pinned))
    assert len(trials_of(until.with_start(plan(budget=20, extra_trials=pinned)))) == 20


def test_a_look_obeys_what_the_plan_says_of_the_bed(tmp_path, monkeypatch):
    class AskedError(Exception):
        pass

    def look(*_, alpha, criteria, **__):
        raise AskedError(alpha, criteria.bed_scatter, criteria.drift)

    monkeypatch.setattr("sandbot_model.design.look.look", look)
    monkeypatch.setattr("sandbot_model.data.conditions.cells_of", lambda _: None)
    monkeypatch.setattr("sandbot_record.trials.from_bags.campaign", lambda *_: SimpleNamespace(trials=None))
    monkeypatch.setattr(until, "_count_ok", lambda *_: 0)
    begun = until.with_start(plan(alpha=0.05, bed_scatter=0.003, bed_drift=0.01))
    with pytest.raises(AskedError) as asked:
        until.decide(begun, CampaignFolder(tmp_path))
    assert asked.value.args == (0.05, 0.003, 0.01)


def test_a_stop_leaves_the_plan_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(until, "_look", lambda *_: {"text": "enough", "stop": "enough", "next": []})
    begun = until.with_start(plan())
    assert until.decide(begun, CampaignFolder(tmp_path))[0] == begun


def test_a_look_torn_by_a_kill_is_taken_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(until, "_look", lambda *_: {"text": "so far", "stop": "", "next": [ASKED]})
    folder = CampaignFolder(tmp_path)
    whole = json.dumps(entry(planned=3))
    folder.looks.write_text(f"{whole}\n{whole[:20]}")
    assert until.decide(until.with_start(plan()), folder)[1]["look"] == 2
    assert [one["look"] for one in until.looks_of(folder)] == [1, 2]


@pytest.mark.parametrize(("ok", "look"), [({"ok": 0}, 1), ({}, 2)])
def test_a_look_that_does_not_say_how_many_trials_were_ok_is_taken_anew(tmp_path, monkeypatch, ok, look):
    monkeypatch.setattr(until, "_look", lambda *_: {"text": "so far", "stop": "", "next": [ASKED]})
    folder = CampaignFolder(tmp_path)
    folder.looks.write_text(json.dumps(entry(**ok)) + "\n")
    assert until.decide(until.with_start(plan()), folder)[1]["look"] == look


def test_a_line_that_is_no_look_is_named(tmp_path):
    folder = CampaignFolder(tmp_path)
    folder.looks.write_text("nonsense\n")
    with pytest.raises(InputError, match=r"looks\.jsonl: line 1"):
        until.looks_of(folder)


def test_a_campaign_may_be_given_more_to_spend_and_no_other_plan(tmp_path):
    folder = CampaignFolder(tmp_path / "run")
    begun = until.with_start(plan())
    folder.adopt(begun, {})
    assert folder.grown(plan(budget=30)).extra_trials == begun.extra_trials
    folder.adopt(folder.grown(plan(budget=30)), {})
    with pytest.raises(InputError, match="another plan"):
        folder.adopt(until.with_start(plan(alpha=0.1)), {})


def test_the_trial_whose_frames_are_kept_does_not_change_as_the_campaign_grows():
    begun = until.with_start(plan())
    grown = until.with_block(begun, [{"phi": 0.633, "omega_rad_s": 16}])
    assert sample_trial(begun).trial_id == sample_trial(grown).trial_id


def test_before_any_bag_trials_cost_their_walk_and_after_it_what_the_bed_took(tmp_path):
    folder, begun = CampaignFolder(tmp_path), until.with_start(plan())
    cost = until.trial_cost(begun, folder)
    assert cost((0.58, 8.0)) == pytest.approx(begun.duration_s(8.0) + begun.standing_s)
    took = {0.58: 12.0, 0.6: 24.0, 0.633: 110.0}
    for trial in trials_of(begun):
        bag = folder.bag(trial)
        bag.mkdir(parents=True)
        walk_s = begun.duration_s(trial.omega_rad_s) + begun.standing_s
        file = metadata.FileInfo("x.mcap", 0, int(1e9 * (took[trial.phi] + walk_s)), 1)
        metadata.write(bag, metadata.BagInfo(files=[file]))
    cost = until.trial_cost(begun, folder)
    for phi, bed_s in took.items():
        assert cost((phi, 24.0)) == pytest.approx(bed_s + begun.duration_s(24.0) + begun.standing_s, rel=1e-6)
    assert cost((0.58, 24.0)) < cost((0.59, 24.0)) < cost((0.6, 24.0))
