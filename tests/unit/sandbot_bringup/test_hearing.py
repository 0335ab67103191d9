"""What a campaign makes of what it hears, and what the gate does about it: without a graph."""

import numpy as np
import pytest

from sandbot_bringup.endings import CampaignEnds
from sandbot_bringup.gate_node import Gate
from sandbot_bringup.hearing_node import STEADY_S, Hearing
from sandbot_common import messages, topics


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
    assert hearing.tells_motion
    hearing._listening.now_s += 2 * STEADY_S
    assert not hearing.tells_motion
    tell_legs(hearing, 0.0)
    assert not hearing.tells_motion
