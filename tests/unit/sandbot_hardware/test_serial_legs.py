"""Set-points as anybody may send them, at the driver of the legs: without a graph or a line."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_common import messages, topics
from sandbot_common.host_clock import HostClock
from sandbot_common.lease import Lease
from sandbot_hardware.device_clock import DeviceClock
from sandbot_hardware.lines import Line, decode
from sandbot_hardware.nodes.serial_legs_node import SerialLegs

SIX = np.ones(6)


class Nobody:
    """No partner has ended, no rival is there, and nothing goes out by a line."""

    def __init__(self):
        self.written = []

    rivals = ""

    def begin(self, _):
        pass

    def fault(self):
        return self.rivals

    def lost(self, *_):
        return ""

    def write(self, data):
        self.written.append(data)
        return True


@pytest.fixture
def legs():
    one = object.__new__(SerialLegs)
    one._order, one._partners, one._port, one._lease = topics.LEGS, Nobody(), Nobody(), Lease(60.0)
    one._rivals, one._moving, one._lapsed = Nobody(), False, False
    one.get_logger = lambda: type("Log", (), {"error": lambda *_: None})
    one._sent = one._refused = one._watchdog = one._watchdog_before = 0
    one._said = []
    one._health = SimpleNamespace(publish=lambda: one._said.append(one._why))
    one._least_ns, one._why, one._held, one._commanded_ns, one._commanded = 0, "", [], 0, SIX
    one._device_clock, one._states = DeviceClock(), SimpleNamespace(publish=lambda _: None)
    one._host_clock, one._ahead_ns = HostClock(), 0
    return one


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ({"position": []}, "6 names, 0 angles, 6 rates"),
        ({"velocity": [1.0] * 5}, "6 names, 6 angles, 5 rates"),
        ({"name": []}, "0 names, 6 angles, 6 rates"),
        ({"name": ["tail", *topics.LEGS[1:]]}, "no leg 'front_left' among tail, "),
    ],
)
@pytest.mark.parametrize("walking", [False, True])
def test_a_set_point_that_is_not_whole_is_refused_and_stops_legs(legs, spoil, said, walking):
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, 0 * SIX, SIX))
    if walking:
        legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, SIX, SIX))
    assert legs._moving == walking
    message = messages.joint_state(2, topics.LEGS, SIX, SIX, SIX)
    for name, values in spoil.items():
        setattr(message, name, values)
    legs._on_setpoint(message)
    assert (legs._refused, legs._moving) == (1, False)
    assert legs._why.startswith(f"{'legs stopped' if walking else 'set-point refused'}: set-points: {said}")
    assert len(legs._port.written) == (3 if walking else 1)


@pytest.mark.parametrize("far", [1e300, -1e300, 1e7])
def test_legs_are_not_told_to_rest_where_no_leg_can_be(legs, far):
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, far * SIX, 0 * SIX, SIX))
    assert (legs._refused, legs._port.written) == (1, [])
    assert "an angle of 1e+" in legs._why
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, 9e5 * SIX, 0 * SIX, SIX))  # after days of walking
    assert len(legs._port.written) == 1


@pytest.mark.parametrize("odd", [np.nan, np.inf, -1e300])
def test_a_report_of_no_angle_is_passed_on_and_no_place_to_hold_the_legs_at(legs, odd):
    """After a reset of a controller that reports NaN once, the legs were told to rest at NaN."""
    published = []
    legs._states = SimpleNamespace(publish=published.append)
    legs._lapsed = True
    for angle in (0.25, odd):
        legs._heard(Line("L", (1, *[angle] * 6, *[0.0] * 12)), 1)
    assert list(published[-1].position) == pytest.approx([odd] * 6, nan_ok=True)
    legs._on_setpoint(messages.joint_state(2, topics.LEGS, SIX, 0 * SIX, SIX))
    assert decode(legs._port.written.pop()[:-1]).values[1:] == (0.25,) * 6 + (0.0,) * 6


def test_one_that_is_whole_goes_out(legs):
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, 0 * SIX, SIX))
    legs._on_setpoint(messages.joint_state(2, topics.LEGS, SIX, SIX, SIX))
    assert (legs._refused, legs._sent, len(legs._port.written)) == (0, 2, 2)


def test_what_the_legs_report_meanwhile_is_not_what_they_are_told(legs):
    reported = Line("L", (5, *[0.25] * 6, *[0.0] * 12))
    legs._lease = SimpleNamespace(renew=lambda _: legs._heard(reported, 1), late=lambda _: False, limit_s=60.0)
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, 0 * SIX, SIX))
    assert legs._held == [0.25] * 6
    assert decode(legs._port.written[0].strip()).values[1:7] == pytest.approx(SIX, abs=1e-5)


def test_a_second_commander_brings_the_legs_to_rest_until_one_has_told_them_rest(legs):
    def send(rate):
        legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, rate * SIX, SIX))
        return legs._moving

    assert not send(0.0)
    assert send(8.0)
    legs._rivals.rivals = "clock and replay both publish /leg_setpoints"
    assert not send(8.0)
    assert legs._why == "legs stopped: clock and replay both publish /leg_setpoints"
    assert legs._port.written[-1].split()[-7:-1] == [b"0.00000"] * 6
    assert not send(8.0)
    assert not send(0.0)  # his, perhaps, at angles of his own
    assert len(legs._port.written) == 3
    legs._rivals.rivals = ""
    assert not send(8.0)
    assert not send(0.0)
    assert send(8.0)


@pytest.mark.parametrize(("angle", "rate"), [(9.0, 8.0), (9.0, 0.0), (1e300, 8.0), (1.04, 1e4), (1.04, np.nan)])
def test_what_no_leg_can_follow_stops_them_where_they_were(legs, angle, rate):
    """A jump on the time line of a replay went to the motors."""
    legs._on_setpoint(messages.joint_state(0, topics.LEGS, SIX, 0 * SIX, SIX))
    legs._on_setpoint(messages.joint_state(5_000_000, topics.LEGS, 1.04 * SIX, 8.0 * SIX, SIX))
    assert legs._moving
    legs._on_setpoint(messages.joint_state(10_000_000, topics.LEGS, angle * SIX, rate * SIX, SIX))
    assert (legs._refused, legs._why[:14]) == (1, "legs stopped: ")
    legs._on_setpoint(messages.joint_state(20_000_000, topics.LEGS, angle * SIX, rate * SIX, SIX))
    assert not legs._moving
    assert {decode(line[:-1]).values[1:] for line in legs._port.written[2:]} == {(1.04,) * 6 + (0.0,) * 6}


def test_a_driver_that_comes_in_mid_gait_moves_nothing_until_told_rest_and_then_stays_where_the_legs_are(legs):
    legs._lapsed = True  # as every driver begins
    legs._heard(Line("L", (1, *[0.25] * 6, *[0.0] * 12)), 1)
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, 50 * SIX, SIX, SIX))
    assert (legs._refused, legs._port.written) == (1, [])
    legs._on_setpoint(messages.joint_state(2, topics.LEGS, 50 * SIX, 0 * SIX, SIX))
    assert decode(legs._port.written.pop()[:-1]).values[1:] == (0.25,) * 6 + (0.0,) * 6
    legs._on_setpoint(messages.joint_state(3, topics.LEGS, 50 * SIX, SIX, SIX))
    assert legs._moving


def test_what_stopped_the_legs_is_said_at_once_and_until_they_walk_again(legs):
    """A campaign asks as soon as they rest, and has the clock say rest, which cleared it before it was said."""

    def send(rate):
        legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, rate * SIX, SIX))

    for rate in (0.0, 8.0):
        send(rate)
    legs._heard(Line("W", (1,)), 1)
    send(0.0)
    assert legs._why == "legs stopped: their controller heard no set-point in time"
    assert legs._said == [legs._why]
    assert not legs._moving
    send(8.0)
    assert legs._moving  # the walk after it is another
    assert legs._why == ""
    send(8.0)
    assert legs._said[1:] == []


def test_a_walk_begins_within_the_lease_of_a_word_of_rest(legs):
    """A driver that was frozen meanwhile, or has only just met the clock, would begin in mid-gait."""
    legs._on_setpoint(messages.joint_state(1, topics.LEGS, SIX, 0 * SIX, SIX))
    legs._lease.renewed_s -= 61.0
    legs._on_setpoint(messages.joint_state(2, topics.LEGS, SIX, SIX, SIX))
    assert not legs._moving
    assert legs._why == "set-point refused: they are told to move before they have been told to rest"


@pytest.mark.parametrize("step_s", [0.0, 15.0, 3600.0, -0.5, -15.0])
def test_states_follow_a_host_clock_that_is_set_and_the_controller_s_time_does_not(legs, step_s):
    """It was taken for delay: stamps were as far behind for hours, and every trial failed."""
    ahead_ns, stamps = [10**18], []
    legs._host_clock.ahead_ns = lambda: ahead_ns[0]
    legs._states.publish = lambda states: stamps.append(messages.nanoseconds(states.header.stamp))
    for index in range(4):
        ahead_ns[0] += round(step_s * 1e9) if index == 2 else 0
        legs._heard(Line("L", (7 + 20_000 * index, *[0.0] * 18)), 5_000_000_000 + 20_000_000 * index)
        walk_ns = ahead_ns[0] + 20_000_000 * index
        legs._on_setpoint(messages.joint_state(walk_ns, topics.LEGS, SIX, 0 * SIX, SIX))
    steps_ns = [20_000_000, 20_000_000 + round(step_s * 1e9), 20_000_000]
    assert np.diff(stamps).tolist() == steps_ns
    assert np.diff([decode(line[:-1]).values[0] for line in legs._port.written]).tolist() == [20_000] * 3


def test_a_walk_keeps_the_time_it_began_with_although_the_clock_is_set(legs):
    ahead_ns = [10**18]
    legs._host_clock.ahead_ns = lambda: ahead_ns[0]
    for index, rate in enumerate((0.0, 8.0, 8.0, 0.0)):
        legs._on_setpoint(messages.joint_state(10**18 + 5_000_000 * index, topics.LEGS, SIX, rate * SIX, SIX))
        ahead_ns[0] += 15 * 10**9 if index == 1 else 0
    assert [decode(line[:-1]).values[0] for line in legs._port.written] == [0, 5_000, 10_000, 15_000]


def test_set_points_that_are_handed_on_late_stop_the_legs_and_a_late_word_of_rest_is_obeyed(legs):
    """They stood in a queue for a line that is too slow, and legs walked on for as long after a stop."""
    now_ns = time.monotonic_ns()

    def send(late_s, rate=1.0):
        legs._on_setpoint(messages.joint_state(now_ns - round(late_s * 1e9), topics.LEGS, SIX, rate * SIX, SIX))
        return legs._moving

    assert not send(4000.0, 0.0)  # whatever his clock shows
    assert send(3900.0)
    assert send(100.0)
    assert send(130.0)
    assert not send(190.0)
    assert legs._why.startswith("legs stopped: set-points are forwarded 9")
    assert not send(180.0)
    count = len(legs._port.written)
    assert not send(500.0, 0.0)
    assert len(legs._port.written) == count + 1
    assert send(490.0)
