"""The clock node as a real process over DDS."""

import json
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float32

from sandbot_clock.clock_parameters import ClockParameters
from sandbot_clock.nodes import clock_node
from sandbot_clock.nodes.clock_node import ClockNode
from sandbot_clock.phase_clock import PhaseClock
from sandbot_clock.schedule import NANO, Schedule
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot, to_mapping
from sandbot_common.ros import endpoints
from sandbot_common.standstill import RAN, STOPPED, Standstill

pytestmark = pytest.mark.ros


@pytest.fixture
def clock(domain):
    # As patient with a busy machine as it can be: that it heeds its lateness is tested in tests/faults.
    process = subprocess.Popen(
        [sys.executable, "-m", "sandbot_clock.nodes.clock_node", "--ros-args", "-p", "late_s:=0.25"]
    )
    yield
    process.terminate()
    assert process.wait(timeout=30) == 0


def test_what_was_asked_of_a_frozen_clock_moves_no_leg_when_it_thaws():
    one = object.__new__(ClockNode)
    one._running, one._settings = False, SimpleNamespace(current=SimpleNamespace(max_run_s=30.0))
    one._standstill = SimpleNamespace(refusal=lambda now_s: "held up")
    one.start = lambda: pytest.fail("legs move")
    assert one._on_start(None, SimpleNamespace()) == SimpleNamespace(success=False, message="held up")


def test_a_stop_outlives_a_start_that_was_asked_for_before_it_and_no_later_one():
    """Two people at two consoles: one's Start waited for its lease when the other pressed STOP."""
    one, started, cancelled = object.__new__(ClockNode), [], []
    one._running, one._settings = False, SimpleNamespace(current=ClockParameters())
    one._thread, one._standstill = None, Standstill(time.monotonic())
    one._autostart = SimpleNamespace(cancel=lambda: cancelled.append(True))
    one.start = lambda: started.append(True) or ""
    assert one._on_stop(None, SimpleNamespace()).message == "was not running"
    assert one._on_start(None, SimpleNamespace()) == SimpleNamespace(success=False, message=STOPPED)
    assert (started, cancelled) == ([], [True])
    one._standstill = Standstill(time.monotonic(), {STOPPED: time.monotonic() - 0.1})
    assert one._on_start(None, SimpleNamespace()).success
    assert started == [True]


def test_runs_on_schedule_stops_at_rest_and_heeds_the_air(clock, beside):
    setpoints = []
    endpoints.subscription(beside.node, topics.LEG_SETPOINTS, setpoints.append)
    blower, trial = (endpoints.publisher(beside.node, topic) for topic in (topics.BED_BLOWER, topics.TRIAL))
    assert beside.call("/clock/start").success
    beside.until(lambda: len(setpoints) > 100)
    # Who has not heard the first one has come in mid-gait.
    assert [any(message.velocity) for message in setpoints[:2]] == [False, True]
    assert setpoints[0].position == setpoints[1].position
    assert beside.call("/clock/start").message == "was running"  # the answer to the first may have been lost
    refused = beside.call("/clock/home")
    assert not refused.success
    assert beside.call("/clock/stop").message == RAN
    beside.until(lambda: not any(setpoints[-1].velocity))
    stamps = np.array([messages.nanoseconds(message.header.stamp) for message in setpoints])
    # Scheduled instants: whole multiples of 5 ms apart to the nanosecond, whatever the machine did.
    assert set(np.diff(stamps) % 5_000_000) == {0}
    angles = np.array([message.position for message in setpoints])
    assert np.all(np.diff(angles, axis=0) >= 0)
    assert all(len(message.effort) == 6 for message in setpoints)

    beside.until(lambda: blower.get_subscription_count() == trial.get_subscription_count() == 1)
    setpoints.clear()
    assert beside.call("/clock/start").success
    beside.until(lambda: setpoints)
    np.testing.assert_allclose(setpoints[0].position, angles[-1])  # goes on from where it held

    four = Robot(legs_per_tripod=2, leg_order=("left_front", "right_rear", "left_rear", "right_front"))
    trial.publish(messages.string(json.dumps({"robot": to_mapping(four)})))
    assert list(setpoints[-1].name) == list(topics.LEGS)  # legs do not change their names while they run

    def of_four():
        """Whether a new start moves the trial's robot; it may not have been heard yet."""
        beside.call("/clock/stop")
        setpoints.clear()
        assert beside.call("/clock/start").success
        beside.until(lambda: setpoints and any(setpoints[-1].velocity))
        return tuple(setpoints[-1].name) == four.leg_order and len(setpoints[-1].position) == 4

    beside.until(of_four)
    second = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    beside.until(lambda: not any(setpoints[-1].velocity))
    assert "beside and clock both publish" in beside.call("/clock/start").message
    beside.node.destroy_publisher(second)
    beside.until(lambda: beside.call("/clock/start").success)
    beside.until(lambda: any(setpoints[-1].velocity))
    blower.publish(messages.float64(0.4))
    beside.until(lambda: not any(setpoints[-1].velocity))
    answer = beside.call("/clock/start")
    assert not answer.success
    assert "air is on (/bed/blower is 0.4)" in answer.message


def test_a_bed_and_a_robot_that_send_best_effort_are_heard(clock, beside):
    node, setpoints = beside.node, []
    endpoints.subscription(node, topics.LEG_SETPOINTS, setpoints.append)
    kind = {topic: messages.message_class(topic.type) for topic in (topics.BED_BLOWER, topics.LEG_STATES)}
    blower, legs = (node.create_publisher(kind[topic], topic.relative, qos_profile_sensor_data) for topic in kind)
    zero, level = np.zeros(6), 0.5

    def report():
        blower.publish(messages.float64(level))
        legs.publish(messages.joint_state(0, topics.LEGS, zero, zero, zero))

    node.create_timer(0.02, report)
    beside.until(lambda: blower.get_subscription_count() == legs.get_subscription_count() == 1)
    beside.until(lambda: "air is on (/bed/blower is 0.5)" in beside.call("/clock/start").message)
    level = 0.0
    beside.until(lambda: beside.call("/clock/start").success)
    # A robot that counts as silent would have stopped the clock after 0.25 s, a busy machine aside.
    beside.until(lambda: len(setpoints) > 200 and any(setpoints[-1].velocity))
    level = 0.5
    beside.until(lambda: not any(setpoints[-1].velocity))


def test_no_leg_moves_beside_a_bed_that_cannot_be_understood(clock, beside):
    strange = beside.node.create_publisher(Float32, topics.BED_BLOWER.relative, 10)

    def answer():
        beside.call("/clock/stop")
        return beside.call("/clock/start").message

    said = "not known: beside publishes /bed/blower as std_msgs/msg/Float32, not std_msgs/msg/Float64"
    beside.until(lambda: said in answer())
    beside.node.destroy_publisher(strange)
    beside.until(lambda: answer().startswith("running"))


@pytest.fixture
def running():
    """A clock under way, and its settings: without a graph."""
    one = object.__new__(ClockNode)
    one._settings, one._running = SimpleNamespace(current=ClockParameters()), True
    return one, one._settings


def test_how_long_a_run_may_last_holds_at_once(running):
    clock, settings = running
    assert not clock._overrun(20 * NANO)
    settings.current = ClockParameters(max_run_s=2.0)
    assert clock._overrun(20 * NANO) == "the run was 2 s long (max_run_s)"


@pytest.mark.parametrize("breaks", [True, False])
def test_a_clock_whose_schedule_breaks_says_so_and_can_start_again(running, monkeypatch, breaks):
    clock, _ = running
    monkeypatch.setattr(clock_node, "ask_for_real_time", lambda _: True)
    told, begun_ns = [], time.monotonic_ns()
    clock.get_logger = lambda: SimpleNamespace(error=told.append)
    clock._health = SimpleNamespace(level=0, text="ok", publish=lambda: None)
    clock._late_ns, clock._stopping, clock._missed = [], threading.Event(), 0
    clock._legs = PhaseClock(ClockParameters().gait_used, 8.0).started(begun_ns / NANO)
    clock._fault = lambda *_: {}["graph"] if breaks else ""
    clock._send = lambda *_: clock._stopping.set()
    clock._run(Schedule(begun_ns, 200.0), 0, topics.LEGS)
    assert not clock.running
    assert not clock._legs.running  # the next start goes on from the angles last sent
    assert told == (["stopped: KeyError: 'graph'"] if breaks else [])
    assert clock._health.level == (2 if breaks else 0)


@pytest.mark.parametrize("name", ["lease_s", "robot_s"])
def test_what_a_run_began_with_is_not_changed_under_it(running, name):
    clock, _ = running
    with pytest.raises(InputError, match=f"{name} is of the run under way"):
        clock._check(ClockParameters(**{name: 1.0}))
    clock._check(ClockParameters(max_run_s=2.0, omega_rad_s=4.0))
    clock._running = False
    clock._check(ClockParameters(**{name: 1.0}))


def test_a_robot_that_comes_while_the_clock_runs_stops_it_and_begins_at_home(clock, beside):
    setpoints, told = [], {}
    endpoints.subscription(beside.node, topics.LEG_SETPOINTS, setpoints.append)
    endpoints.subscription(
        beside.node, topics.DIAGNOSTICS, lambda message: told.update({one.name: one for one in message.status})
    )
    assert beside.call("/clock/start").success
    beside.until(lambda: len(setpoints) > 100)
    home = setpoints[0].position
    states = endpoints.publisher(beside.node, topics.LEG_STATES)

    def report():
        states.publish(messages.joint_state(1, topics.LEGS, *np.zeros((3, 6))))

    beside.node.create_timer(0.02, report)
    beside.until(lambda: not any(setpoints[-1].velocity))
    beside.until(lambda: told["clock"].message == "stopped: a robot came while the clock ran (/leg_states)")
    setpoints.clear()
    assert beside.call("/clock/start").success
    beside.until(lambda: setpoints)
    assert setpoints[0].position == home
