import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_hardware import lines
from sandbot_hardware.device_clock import DeviceClock
from sandbot_hardware.devices import BedController, LegController
from sandbot_hardware.lines import Line, Reader

LEASE_S, MOVING, REST = 0.24, 5.0, 0.0


def setpoint(rate, t_s=0.0, angle=0.1):
    return Line("S", (round(t_s * 1e6), *[angle] * 6, *[rate] * 6))


def kinds(said):
    return [line.kind for line in Reader().feed(b"".join(said))]


def leg_controller():
    begun = []
    return told_rest(lambda t_s, angles, rates: (angles, rates, [0.0] * 6), begun.append), begun


def told_rest(walk, begin=lambda t_s: None):
    """A controller that begins as deaf to motion as after a silence, and has been told rest."""
    legs = LegController(6, walk, begin, LEASE_S)
    assert legs.heard(setpoint(MOVING, -0.5), 0.5) == []
    legs.heard(setpoint(REST, -0.5), 0.5)
    return legs


def test_legs_follow_and_the_led_goes_on_once():
    legs, begun = leg_controller()
    assert kinds(legs.heard(setpoint(MOVING), 1.0)) == ["E", "L"]
    assert kinds(legs.heard(setpoint(MOVING, 0.005), 1.005)) == ["L"]
    assert (legs.moving, begun) == (True, [1.0])


def test_set_points_that_come_together_are_obeyed_at_their_own_times():
    walked = []

    def walk(t_s, angles, rates):
        walked.append(t_s)
        return angles, rates, rates

    legs = told_rest(walk)
    walked.clear()
    for index, heard_s in enumerate((1.0, 1.005, 1.03, 1.03, 1.03)):
        legs.heard(setpoint(MOVING, 50.0 + 0.005 * index), heard_s)
    assert walked == pytest.approx([1.0, 1.005, 1.01, 1.015, 1.02], abs=1e-5)


@pytest.mark.parametrize(("again_s", "is_walked"), [(50.0, False), (49.99, False), (50.00005, False), (50.005, True)])
def test_a_set_point_of_a_time_already_reported_renews_the_lease_but_is_not_walked(again_s, is_walked):
    """At an invented time, 1 us later, a leg would turn at 4e4 rad/s: the simulated robot refused it, and ended."""
    walked = []

    def walk(t_s, angles, rates):
        walked.append(t_s)
        return angles, rates, rates

    legs = told_rest(walk)
    walked.clear()
    legs.heard(setpoint(MOVING, 50.0), 1.0)
    said = legs.heard(setpoint(MOVING, again_s, 0.2), 1.1)
    assert (kinds(said), len(walked)) == ((["L"], 2) if is_walked else ([], 1))
    assert legs.tick(1.1 + LEASE_S - 0.001) == []
    legs.heard(setpoint(MOVING, 50.02, 0.3), 1.12)
    assert walked[-1] == pytest.approx(1.02, abs=1e-4)


@pytest.mark.parametrize("late_s", [0.0, 0.015, 0.03, 0.0351, 0.1])
def test_a_walk_whose_first_set_points_come_late_and_together_is_walked_at_their_own_times(late_s):
    """As on a busy host, after rest was reported: nothing else was wrong when the simulated devices ended."""
    begun, walked = [], []
    legs = told_rest(lambda t_s, angles, rates: walked.append((t_s, angles[0])) or (angles, rates, rates), begun.append)
    legs.heard(setpoint(REST, 50.0), 1.0)
    legs.tick(1.0 + late_s)  # reports rest, 20 ms after the last report or later
    walked.clear()
    said = [
        legs.heard(setpoint(MOVING, 50.0 + 0.005 * n, 0.1 + 0.04 * n), 1.0 + max(late_s, 0.005 * n))
        for n in range(1, 30)
    ]
    assert legs.moving
    assert [t_s for t_s, _ in walked] == pytest.approx([1.0 + (angle - 0.1) / 8.0 for _, angle in walked], abs=1e-4)
    assert walked[0][0] == pytest.approx(begun[0])
    assert begun[0] < 1.0 + late_s + 0.0051
    assert [kind for one in said for kind in kinds(one)].count("E") == 1


def test_rest_that_comes_late_is_obeyed_at_once():
    legs, _ = leg_controller()
    legs.heard(setpoint(MOVING, 50.0), 1.0)
    legs.heard(setpoint(REST, 49.99, 0.1), 1.01)
    assert not legs.moving
    assert kinds(legs.tick(1.03)) == ["L"]


def test_legs_that_hear_nothing_rest_by_themselves_and_are_deaf_until_told_rest():
    legs, _ = leg_controller()
    legs.heard(setpoint(MOVING), 1.0)
    assert legs.tick(1.0 + LEASE_S - 0.001) == []
    assert legs.moving
    assert kinds(legs.tick(1.0 + LEASE_S + 0.001)) == ["L", "W"]
    assert not legs.moving
    legs.heard(setpoint(MOVING), 1.3)  # the host wakes up: that is no start
    assert not legs.moving
    legs.heard(setpoint(REST), 1.31)
    legs.heard(setpoint(MOVING), 1.32)
    assert legs.moving


def test_a_late_set_point_does_not_slip_in_before_the_watchdog_looks():
    legs, _ = leg_controller()
    legs.heard(setpoint(MOVING), 1.0)
    legs.heard(setpoint(MOVING), 2.0)
    assert not legs.moving


def test_legs_at_rest_report_by_themselves_without_a_watchdog():
    legs, _ = leg_controller()
    assert kinds([one for t in range(100) for one in legs.tick(1.0 + 0.005 * t)]) == ["L"] * 25


def test_what_is_no_set_point_moves_nothing():
    legs, begun = leg_controller()
    for line in (Line("S", ()), Line("S", (1.0,) * 12), Line("B", (1.0,) * 13)):
        assert legs.heard(line, 1.0) == []
    assert begun == []


def test_air_that_is_not_renewed_goes_off():
    blown = []
    bed = BedController(lambda level, t_s: blown.append((level, t_s)), lambda t_s: 0.1, 0.45)
    bed.heard(Line("B", (1.0,)), 1.0)
    bed.heard(Line("B", (7.0,)), 1.1)  # no level: neither obeyed nor a renewal
    assert kinds(bed.tick(1.44)) == ["H"]
    assert kinds(bed.tick(1.46)) == ["W", "H"]
    assert blown == [(1.0, 1.0), (0.0, 1.46)]
    assert lines.encode("W", lines.AIR_OFF)


@given(st.lists(st.floats(0.0, 0.02), min_size=30, max_size=60), st.integers(-(10**15), 10**15))
def test_a_device_s_time_is_placed_within_the_least_delay(delays_s, offset_ns):
    clock = DeviceClock()
    for index, delay_s in enumerate(delays_s):
        said_ns = index * 10_000_000
        placed_ns = clock.host_ns(said_ns, said_ns + offset_ns + round(delay_s * 1e9))
        assert placed_ns <= said_ns + offset_ns + round(delay_s * 1e9)  # never after it arrived
    drift_ns = 1e-4 * len(delays_s) * 30_000_000
    assert abs(placed_ns - said_ns - offset_ns) <= min(delays_s) * 1e9 + drift_ns + 1


def test_a_device_that_was_started_anew_begins_a_new_time():
    clock = DeviceClock()
    clock.host_ns(100_000_000_000, 500_000_000_000)
    assert clock.host_ns(0, 501_000_000_000) == 501_000_000_000
