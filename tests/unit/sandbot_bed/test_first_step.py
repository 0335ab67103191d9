"""The first step of a preparation, without a graph."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_bed.bed_parameters import BedParameters
from sandbot_bed.nodes.bed_node import BedNode
from sandbot_bed.protocol import PulseProtocol
from sandbot_common import messages, topics
from sandbot_common.standstill import STOPPED, Standstill

TRIGGER = SimpleNamespace(success=None, message="")


class Silent:
    """Whom nobody hears, and who finds nothing wrong."""

    current = BedParameters()

    def __getattr__(self, _):
        return lambda *_: ""

    def read_height_m(self):
        return 0.1


@pytest.fixture
def bed(monkeypatch):
    """A bed's node at rest whose every stage is kept; it has been held up for ten seconds."""
    one = object.__new__(BedNode)
    stages = []
    one._settings = one._command = one._rivals = one._phi = one._status = one._health = one._hardware = Silent()
    one._protocol, one._air_stops, one._reported = PulseProtocol(BedParameters()), {}, ""
    one._legs_moved_s = one._status_s = -float("inf")
    one._step_s, one._standstill = time.monotonic() - 10.0, Standstill(time.monotonic())
    monkeypatch.setattr(BedNode, "_on_new_stage", lambda _, command: stages.append((command.stage, command.reason)))
    monkeypatch.setattr(BedNode, "get_clock", lambda _: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1)))
    return one, stages


def test_what_held_the_bed_up_before_a_preparation_does_not_end_it(bed):
    """It failed in its first step, and a campaign that had not seen it begin waited ten minutes for its end."""
    one, stages = bed
    assert one._on_prepare(None, TRIGGER).success
    assert stages == [("fluidise", "")]  # told before the answer
    one._step()
    assert one._protocol.command.stage == "fluidise"


def test_what_holds_it_up_while_it_blows_does(bed):
    one, stages = bed
    one._on_prepare(None, TRIGGER)
    one._step_s -= 10.0
    one._step()
    assert stages[-1] == ("failed", "the bed node was held up for 10 s")


def test_what_was_asked_of_a_frozen_bed_blows_no_air_when_it_thaws(bed):
    one, stages = bed
    one._standstill = SimpleNamespace(refusal=lambda now_s: "held up")
    answer = one._on_prepare(None, TRIGGER)
    assert (answer.success, answer.message, stages) == (False, "held up", [])


def test_an_abort_outlives_a_preparation_that_was_asked_for_before_it_and_no_later_one(bed):
    """Two people at two consoles: one's Prepare waited for its lease when the other pressed STOP."""
    one, stages = bed
    assert one._on_abort(None, SimpleNamespace()).success
    stages.clear()
    answer = one._on_prepare(None, TRIGGER)
    assert (answer.success, answer.message, stages) == (False, STOPPED, [])
    one._standstill = Standstill(time.monotonic(), {STOPPED: time.monotonic() - 0.1})
    assert one._on_prepare(None, TRIGGER).success


@pytest.mark.parametrize(
    ("rates", "refused"),
    [
        ([], "legs move (/leg_states gives no rates); call /clock/stop first"),
        ([0.0] * 5 + [np.nan], "legs move (/leg_states); call /clock/stop first"),
        ([0.0] * 5 + [-1e-300], "legs move (/leg_states); call /clock/stop first"),
        ([0.0] * 6, ""),
    ],
)
def test_no_air_beside_legs_that_do_not_say_that_they_rest(bed, rates, refused):
    """A driver that reports angles alone, as many do, was a robot at rest, whatever its legs did."""
    one, stages = bed
    message = messages.joint_state(1, topics.LEGS, np.ones(6), np.array(rates), np.zeros(6))
    one._on_legs(topics.LEG_STATES.name, message)
    answer = one._on_prepare(None, SimpleNamespace(success=None, message=""))
    assert (answer.success, answer.message if refused else "") == (not refused, refused)
    assert bool(stages) == (not refused)
