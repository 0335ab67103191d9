"""The timer of all that commands or watches: it goes by the time that has passed, whatever ROS takes the time to be."""

import time

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter

from sandbot_common import node

pytestmark = pytest.mark.ros


@pytest.fixture
def turn(domain):
    """A node whose clock stands still, for it waits for /clock; ``turn(until)`` spins it, for ten seconds at most."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    still = [Parameter("use_sim_time", value=True)]
    one = rclpy.create_node("one", context=context, parameter_overrides=still)
    executor = EventsExecutor(context=context)
    executor.add_node(one)

    def spin(until):
        end = time.monotonic() + 10.0
        while not until() and time.monotonic() < end:
            node.spin_once(executor, one, 0.02)
        return until()

    spin.node = one
    yield spin
    one.destroy_node()
    context.try_shutdown()


def test_it_calls_while_the_time_of_ros_stands_still(turn):
    called, of_ros, begun_s = [], [], time.monotonic()
    node.Timer(turn.node, 0.05, lambda: called.append(time.monotonic()))
    turn.node.create_timer(0.05, lambda: of_ros.append(1))
    assert turn(lambda: len(called) >= 10)
    assert called[9] - begun_s >= 0.5  # no oftener than it was told
    assert not of_ros


def test_it_does_not_catch_up_what_a_busy_loop_missed(turn):
    called = []
    node.Timer(turn.node, 0.05, lambda: called.append(time.monotonic()))
    assert turn(lambda: called)
    count, busy_until_s = len(called), time.monotonic() + 1.0
    while time.monotonic() < busy_until_s:
        pass
    turn(lambda: len(called) > count)
    since_s = called[count]
    turn(lambda: time.monotonic() > since_s + 0.2)
    assert len([at_s for at_s in called if since_s <= at_s <= since_s + 0.2]) <= 6  # not the twenty of the second


def test_what_it_raises_ends_the_loop_and_what_is_cancelled_is_not_called(turn):
    called = []
    node.Timer(turn.node, 0.02, lambda: called.append(1)).cancel()
    node.Timer(turn.node, 0.1, lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        turn(lambda: False)
    assert not called
