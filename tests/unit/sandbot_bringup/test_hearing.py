"""What a campaign makes of what it hears, and what the gate does about it: without a graph."""

import numpy as np
import pytest

from sandbot_bringup.endings import CampaignEnds
from sandbot_bringup.gate_node import Gate
from sandbot_bringup.hearing_node import RECORDER, STEADY_S, Hearing
from sandbot_common import messages, topics
from sandbot_common.node import PROCESS


class Node:
    """Hears nothing by itself."""

    def create_subscription(self, *_, **__):
        pass


@pytest.fixture
def hearing():
    return Hearing(Node(), 1.0, 0.02)


def tell_legs(hearing, rate):
    six = np.zeros(6)
    hearing._on_legs(messages.joint_state(1, topics.LEGS, six, six + rate, six))


def test_no_trial_begins_while_legs_say_that_they_move(hearing):
    gate = Gate(Node(), hearing, None, lambda condition, _: condition())
    gate._pace = gate._has_one_publisher = lambda *_: pytest.fail("it went on")
    hearing.missing = list
    tell_legs(hearing, 8.0)
    with pytest.raises(CampaignEnds, match=r"legs do not come to rest \(/leg_states\)"):
        gate.before_trial(None, None)


def test_who_rests_or_died_in_the_middle_of_a_walk_does_not_say_that_he_moves(hearing):
    tell_legs(hearing, 8.0)
    assert hearing.reports_motion
    hearing._listening.now_s += 2 * STEADY_S
    assert not hearing.reports_motion
    tell_legs(hearing, 0.0)
    assert not hearing.reports_motion


def test_another_recorder_is_not_taken_for_our_own(hearing):
    def says(pid, text, level=0):
        told = {PROCESS: f"host {pid} 77"}
        hearing._on_diagnostics(messages.diagnostics(1, RECORDER, told, level=level, text=text))

    hearing.expect_recorder(42)
    says(41, "ok")
    assert not hearing.heard_since(RECORDER, -1.0)
    says(42, "ok")
    hearing.require_recorder()
    says(41, "ended: SIGINT", level=2)
    assert hearing.statuses[RECORDER][:2] == (0, "ok")
    assert not hearing.fault()
    says(42, "ended: SIGTERM", level=2)
    assert hearing.fault() == "the recorder ended: SIGTERM"


@pytest.mark.parametrize("driver", ["serial_legs", "lateral_camera"])
def test_a_driver_whose_cable_is_out_ends_the_trial(hearing, driver):
    hearing._on_diagnostics(messages.diagnostics(1, driver, {}, level=2, text="the device gives no frames"))
    assert hearing.fault() == f"the {driver} has lost its device: the device gives no frames"
    hearing._on_diagnostics(messages.diagnostics(1, driver, {}))
    assert not hearing.fault()
