"""Set-points as anybody may send them, at the driver of the legs: without a graph or a line."""

import numpy as np
import pytest

from sandbot_common import messages, topics
from sandbot_common.lease import Lease
from sandbot_hardware.serial_legs_node import SerialLegs

SIX = np.ones(6)


class Nobody:
    """No partner has ended, and nothing goes out by a line."""

    def __init__(self):
        self.written = []

    def begin(self, _):
        pass

    def lost(self, *_):
        return ""

    def write(self, data):
        self.written.append(data)
        return True


@pytest.fixture
def legs():
    one = object.__new__(SerialLegs)
    one._order, one._partners, one._port, one._lease = topics.LEGS, Nobody(), Nobody(), Lease(1.0)
    one._moving = one._lapsed = False
    one._sent = one._refused = 0
    return one


@pytest.mark.parametrize("spoil", ["position", "velocity", "name"])
def test_a_set_point_that_is_not_whole_is_refused(legs, spoil):
    message = messages.joint_state(1, topics.LEGS, SIX, SIX, SIX)
    setattr(message, spoil, [])
    legs._on_setpoint(message)
    assert (legs._refused, legs._sent, legs._port.written) == (1, 0, [])


def test_one_that_is_whole_goes_out(legs):
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, SIX, SIX))
    assert (legs._refused, legs._sent, len(legs._port.written)) == (0, 1, 1)
