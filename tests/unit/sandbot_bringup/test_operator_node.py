"""The operator interface of a campaign without a graph."""

import json
from types import SimpleNamespace

import pytest

from sandbot_bringup.hold import Hold
from sandbot_bringup.nodes.operator_node import OperatorInterface
from sandbot_bringup.plan import Plan
from sandbot_bringup.queue import Queue
from sandbot_common import messages
from sandbot_common.errors import InputError


def test_half_a_character_in_a_command_is_answered_and_does_not_end_the_campaign():
    one, said = object.__new__(OperatorInterface), []
    one._answers, one.queue = {}, SimpleNamespace(plan=None)
    one._content = lambda: {"answers": one._answers}
    one._status = SimpleNamespace(publish=lambda message: said.append(message.data.encode()))
    one._on_command(messages.string('{"id": "\\ud800", "do": "dance"}'))
    assert "not a command" in json.loads(said[-1])["answers"]["\ud800"]["message"]


PLAN = Plan(name="tiny", phi=(0.6,), omega_rad_s=(8.0,), replicates=1)


@pytest.mark.parametrize("full", ["journal", "plan", ""])
@pytest.mark.parametrize("do", ["skip", "add"])
def test_a_command_that_cannot_be_kept_is_not_carried_out(full, do):
    one, done = object.__new__(OperatorInterface), []

    def write(file):
        if file == full:
            raise InputError("no space left")
        done.append(file)

    one.queue, one._answers, one.say = Queue(PLAN, ()), {}, lambda: None
    one._journal = SimpleNamespace(add=lambda *_, **__: write("journal"))
    one._keep_plan = lambda _: write("plan")
    before = one.queue.rows()
    what = {"add": {"phi": 0.6, "omega_rad_s": 9.0, "replicates": 1}, "skip": {"trial_id": before[0]["trial_id"]}}
    one._on_command(messages.string(json.dumps({"id": "1", "do": do, **what[do]})))
    carried_out = full == "" or (do, full) == ("skip", "plan")
    assert one._answers["1"]["success"] is carried_out
    assert (one.queue.rows() != before) is carried_out
    # Written down first: a plan that has grown is run when the campaign is resumed.
    assert done == {"journal": [], "plan": ["journal"], "": ["journal", "plan"]}[full][: 1 if do == "skip" else 2]


def test_a_disk_that_cannot_be_asked_does_not_end_the_campaign(tmp_path):
    one = object.__new__(OperatorInterface)
    one._folder = tmp_path
    assert one._free_bytes() > 0
    one._folder = tmp_path / "pulled out"
    assert one._free_bytes() is None


@pytest.mark.parametrize("full", [False, True])
def test_the_last_status_says_that_the_campaign_has_ended_and_why(tmp_path, full):
    """On a full disk, too; one that goes on, as with --redo, is running again."""
    one, said, kept = object.__new__(OperatorInterface), [], []

    def add(who, do, **what):
        if full:
            raise InputError("no space left")
        kept.append((who, do, what))

    one.queue, one.hold, one.look, one._answers, one._folder = Queue(PLAN, ()), Hold(), None, {}, tmp_path
    one._journal = SimpleNamespace(add=add, events=[])
    one._status = SimpleNamespace(publish=lambda message: said.append(json.loads(message.data)))
    one.enter("walking")
    one.end("nothing waits")
    one.enter("walking")
    assert [(status["state"], status["why"], status["stage"]) for status in said] == [
        ("running", "", "walking"),
        ("ended", "nothing waits", ""),
        ("running", "", "walking"),
    ]
    assert kept == [("campaign", "end", {"reason": "nothing waits"})] * (not full)
