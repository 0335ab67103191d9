"""A look of a live campaign, and what the operator asks for meanwhile: without a graph."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.hold import Hold
from sandbot_bringup.nodes.live_node import _Campaign
from sandbot_bringup.plan import Plan, read_plan, trials_of
from sandbot_bringup.queue import Queue

START = {"phi": 0.6, "omega_rad_s": 8.0, "replicates": 2}
PLAN = Plan(
    name="one", phi=(0.6, 0.62), omega_rad_s=(8.0, 16.0), gait="UNIFORM", until="verdict", budget=40,
    extra_trials=(START,),
)  # fmt: skip
BLOCK = {"phi": 0.62, "omega_rad_s": 16.0, "because": "they differ there"}


class Silent:
    """A desk, or a bar, that nobody reads."""

    def __getattr__(self, _):
        return lambda *_, **__: None


def campaign(path, *, added, block):
    """One whose trials are all done; while it looks the operator adds a condition, or does not."""
    one = object.__new__(_Campaign)
    one._folder, one._files, one._interface = CampaignFolder(path), {}, Silent()
    one._folder.adopt(PLAN, {})
    one.queue = Queue(PLAN, [trial.trial_id for trial in trials_of(PLAN)])

    def looked():
        if added:
            one.queue.add({"phi": 0.61, "omega_rad_s": 12.0, "replicates": 1})
            one._folder.adopt(one.queue.plan, {})
        return {"look": 1, "text": "", "stop": "" if block else "adequate", "next": block}

    one._take_look = looked
    return one


@pytest.mark.parametrize("added", [False, True])
@pytest.mark.parametrize("block", [[], [BLOCK]])
def test_what_is_added_during_a_look_is_run_whatever_the_look_says(tmp_path, added, block):
    one = campaign(tmp_path, added=added, block=block)
    assert one._look(Silent()) == bool(added or block)
    asked = [(extra["phi"], extra["omega_rad_s"]) for extra in read_plan(one._folder.plan_file).extra_trials]
    assert asked == [(0.6, 8.0)] + [(0.61, 12.0)] * added + [(0.62, 16.0)] * len(block)
    assert one.queue.waiting == added + len(block)


def test_a_plan_without_a_verdict_is_not_looked_at(tmp_path):
    one = campaign(tmp_path, added=True, block=[BLOCK])
    one.queue.plan = replace(PLAN, until="", budget=0)
    assert not one._look(Silent())


@pytest.mark.parametrize("failing", [[], [1], [1, 3]])
def test_the_bar_counts_a_failed_trial_as_not_done(tmp_path, failing):
    """It ended at 3/3 with one of four trials failed."""
    plan = replace(PLAN, until="", budget=0, extra_trials=(), replicates=1)
    one, bar = object.__new__(_Campaign), SimpleNamespace(n=0, total=0)
    one._folder, one.queue = CampaignFolder(tmp_path), Queue(plan, ())
    one._node = SimpleNamespace(hold=Hold(), await_go=lambda: None)

    def run(trial, bar):
        if bar.n + len(one.queue.failed) + 1 in failing:
            one.queue.fail(trial.trial_id, "no marker")
        else:
            one.queue.finish(trial.trial_id, 1.0, {})
            bar.n += 1

    one._run = run
    while one._run_next(bar):
        pass
    assert (bar.n, bar.total) == (4 - len(failing), 4)


@pytest.mark.parametrize(("finished", "drawn"), [(0, "0/4"), (4, "")])
def test_the_bar_is_of_the_trials_that_wait_and_there_is_none_of_none(capsys, finished, drawn):
    """A line "campaign: 0trial [00:00, ?trial/s]" stood in the log of every campaign."""
    plan = replace(PLAN, until="", budget=0, extra_trials=(), replicates=1)
    one = object.__new__(_Campaign)
    one.queue, one._interface = Queue(plan, [trial.trial_id for trial in trials_of(plan)][:finished]), Silent()
    one._run_next = lambda bar: False
    one.run_all()
    said = capsys.readouterr().err
    assert drawn in said
    assert bool(said) is bool(drawn)
    assert "0trial" not in said
