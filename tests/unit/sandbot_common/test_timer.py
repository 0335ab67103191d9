"""The timer of all that commands or watches: it goes by the time that has passed, whatever ROS takes the time to be."""

import math
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter

import sandbot_common
from sandbot_common.ros import command_node, node
from sandbot_common.ros.timer import Timer, end_timers

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
    Timer(turn.node, 0.05, lambda: called.append(time.monotonic()))
    turn.node.create_timer(0.05, lambda: of_ros.append(1))
    assert turn(lambda: len(called) >= 10)
    assert called[9] - begun_s >= 0.5  # no oftener than it was told
    assert not of_ros


def test_it_does_not_catch_up_what_a_busy_loop_missed(turn):
    called = []
    Timer(turn.node, 0.05, lambda: called.append(time.monotonic()))
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
    Timer(turn.node, 0.02, lambda: called.append(1)).cancel()
    Timer(turn.node, 0.1, lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        turn(lambda: False)
    Timer(turn.node, 0.02, lambda: called.append(2))
    assert turn(lambda: called)  # raised once: what is to be ended takes more turns
    assert 1 not in called


def test_of_a_node_that_ends_no_thread_is_left(turn):
    for period_s in (0.02, 60.0):
        Timer(turn.node, period_s, lambda: None)
    end_timers(turn.node)
    assert [timer._thread.is_alive() for timer in turn.node.waiting] == [False, False]


def test_a_commander_whose_name_is_forgotten_is_no_second_one(turn, monkeypatch):
    """DDS forgets of one that was killed first his name, then that he published."""
    holders = ["_NODE_NAME_UNKNOWN_", "campaign"]
    monkeypatch.setattr(command_node, "names_of", lambda _: holders)
    command = command_node.Command(turn.node, 1.0, command_node.LEGS)
    command._on_renewal(SimpleNamespace(frame_id="campaign"))
    assert command.begin(1.0) == ""
    assert "did not renew" not in command.lost()
    holders[:] = ["another", "campaign"]
    assert "another and campaign both command" in command.begin(1.0)
    # Nobody renews, and somebody of whom no more is known may: it is not as if a person commanded by hand.
    holders[:] = ["_NODE_NAME_UNKNOWN_"]
    command._heard_s = -math.inf
    assert command.begin(1.0).startswith("somebody commands the trackway and does not renew")


@pytest.mark.parametrize(
    ("frame_id", "legs_begin"),
    [("campaign", True), ("campaign legs", True), ("campaign air", False), ("campaign nothing", False)],
)
def test_only_what_the_lease_lets_begin_begins(turn, monkeypatch, frame_id, legs_begin):
    holders = ["campaign"]
    monkeypatch.setattr(command_node, "names_of", lambda _: holders)
    command = command_node.Command(turn.node, 1.0, command_node.LEGS)
    command._on_renewal(SimpleNamespace(frame_id=frame_id))
    refusal = command.begin(1.0)
    assert bool(refusal) is not legs_begin
    assert legs_begin or refusal == f"campaign commands the trackway and lets {frame_id.split()[1]} begin; end it first"
    # What began goes on with every renewal, whatever it lets begin.
    command._on_renewal(SimpleNamespace(frame_id="campaign nothing"))
    assert not command.lost()
    holders.clear()
    assert not command.begin(1.0)  # the campaign is gone, a person commands by hand


def test_no_node_has_a_timer_of_ros_s_own():
    """It stops for a minute when the system clock is set back by one (decision 16)."""
    source = Path(sandbot_common.__file__).resolve().parents[2]
    assert [path for path in source.rglob("*.py") if ".create_timer(" in path.read_text(encoding="utf-8")] == []
