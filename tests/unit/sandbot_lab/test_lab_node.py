"""The node over DDS: a trial played into it comes out as the batch's, frames on the robot's time, no truth told."""

import json
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from rig import setpoints

from sandbot_common import messages, topics
from sandbot_common.lease import Lease
from sandbot_common.robot import SANDBOT, Robot, to_mapping
from sandbot_common.ros import endpoints
from sandbot_lab.nodes.lab_node import LabNode
from sandbot_lab.robot import simulate
from sandbot_lab.world import null_world

pytestmark = pytest.mark.ros

HEARD = (topics.LEG_STATES, topics.SYNC_LED, topics.DORSAL_IMAGE, topics.LATERAL_IMAGE, topics.BED_HEIGHT)
"""The height last: the lab meets subscriptions in their order, so once its height is heard all else is as well."""
SETPOINTS = 100
LATE_NS = 400_000_000
"""After the start: a frame in which two walks differ by millimetres."""


@pytest.fixture
def heard(beside):
    """What the lab said, by topic name."""
    messages = {topic.name: [] for topic in HEARD}
    for topic in HEARD:
        endpoints.subscription(beside.node, topic, messages[topic.name].append)
    return messages


@pytest.fixture
def lab(domain, request):
    seed = getattr(request, "param", 5)
    given = [word for one in ("phi:=0.62", f"trial_seed:={seed}", "legs_lease_s:=1.0") for word in ("-p", one)]
    command = [sys.executable, "-m", "sandbot_lab.nodes.lab_node", "--ros-args", *given]
    process = subprocess.Popen(command)
    yield process
    process.terminate()
    # Taken down before it was up, it is ended by the signal itself.
    assert process.wait(30) in (0, -signal.SIGTERM)


def play(publisher, names, t0_ns, t_s, angles, rates):
    """Set-points in one go, after a word of rest."""
    publisher.publish(messages.joint_state(t0_ns - 1, names, angles[0], np.zeros(6), np.zeros(6)))
    for t, angle, rate in zip(t_s, angles, rates, strict=True):
        publisher.publish(messages.joint_state(t0_ns + round(t * 1e9), names, angle, rate, np.zeros(6)))


def test_the_robot_that_a_trial_tells_walks(lab, beside, heard):
    trial, legs = (endpoints.publisher(beside.node, topic) for topic in (topics.TRIAL, topics.LEG_SETPOINTS))
    beside.until(lambda: trial.get_subscription_count() and legs.get_subscription_count() and heard["/bed/height"])
    t_s, angles, rates = (values[:SETPOINTS] for values in setpoints(16.0))
    rates[-1] = 0.0
    states = heard["/leg_states"]

    def walks_as(robot):
        """One trial; the robot that was told last may not have been heard yet."""
        states.clear()
        t0_ns = beside.node.get_clock().now().nanoseconds
        play(legs, robot.leg_order, t0_ns, t_s, angles, rates)
        beside.until(lambda: len(states) == SETPOINTS)
        if [tuple(state.name) for state in states] != [robot.leg_order] * SETPOINTS:
            return False
        walked = simulate(null_world().walked_by(robot), 0.62, t_s, angles, rates, seed=5).leg_effort_n_m
        return np.array([state.effort for state in states]) == pytest.approx(walked, abs=1e-6)

    assert walks_as(SANDBOT)
    big = Robot(leg_radius_m=0.05, mass_per_leg_kg=1.5, leg_order=(*topics.LEGS[3:], *topics.LEGS[:3]))
    trial.publish(messages.string(json.dumps({"robot": to_mapping(big)})))
    beside.until(lambda: walks_as(big))
    trial.publish(messages.string(json.dumps({"robot": {"leg_radius_m": 9999.0}})))
    assert walks_as(big)


@pytest.mark.parametrize(("lab", "alike"), [(0, False), (5, True)], indirect=["lab"])
def test_a_robot_that_is_told_no_seed_walks_otherwise_in_each_trial(lab, beside, heard, alike):
    """Replicates of one chance share one error, which no analysis can see."""
    legs = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    beside.until(lambda: legs.get_subscription_count() and heard["/bed/height"])
    t_s, angles, rates = (values[:SETPOINTS] for values in setpoints(16.0))
    rates[-1] = 0.0
    seen, frames = [], heard[topics.DORSAL_IMAGE.name]
    for _ in range(2):
        frames.clear()
        t0_ns = beside.node.get_clock().now().nanoseconds
        play(legs, topics.LEGS, t0_ns, t_s, angles, rates)
        beside.until(
            lambda t0_ns=t0_ns: [one for one in frames if messages.nanoseconds(one.header.stamp) - t0_ns >= LATE_NS]
        )
        late = [one for one in frames if messages.nanoseconds(one.header.stamp) - t0_ns == LATE_NS]
        seen.append(bytes(late[0].data))
    assert (seen[0] == seen[1]) == alike


def test_a_trial_over_dds_is_the_batch_trial(lab, beside, heard):
    listener, until = beside.node, beside.until
    publisher = endpoints.publisher(listener, topics.LEG_SETPOINTS)
    until(lambda: publisher.get_subscription_count() and heard["/bed/height"])
    t_s, angles, rates = (values[:SETPOINTS] for values in setpoints(16.0))
    t0_ns = listener.get_clock().now().nanoseconds
    play(publisher, topics.LEGS, t0_ns, t_s, angles, rates)
    frames = heard[topics.DORSAL_IMAGE.name]
    # More, where the lease ends before they have all arrived: the set-points came in one go.
    until(lambda: len(heard["/leg_states"]) >= SETPOINTS and len(frames) >= SETPOINTS // 2)

    batch = simulate(null_world(), 0.62, t_s, angles, rates, seed=5)
    efforts = np.array([state.effort for state in heard["/leg_states"][:SETPOINTS]])
    assert efforts == pytest.approx(batch.leg_effort_n_m, abs=1e-6)
    stamps = [messages.nanoseconds(frame.header.stamp) - t0_ns for frame in frames[: SETPOINTS // 2]]
    assert stamps == [k * 10_000_000 for k in range(SETPOINTS // 2)]
    assert [messages.nanoseconds(edge.stamp) for edge in heard["/sync_led"]] == [t0_ns]

    # Moving legs can't be reset; standing ones can, and the next start is a new trial.
    def send(rate: float) -> None:
        now_ns = listener.get_clock().now().nanoseconds
        publisher.publish(messages.joint_state(now_ns, topics.LEGS, angles[-1], np.full(6, rate), np.zeros(6)))

    def move() -> None:
        # Rest first, where a busy machine lost the lease: nothing goes on by itself.
        if not any(heard["/leg_states"][-1].velocity):
            send(0.0)
        send(16.0)

    renewal = listener.create_timer(0.02, move)
    until(lambda: not beside.call("/lab/reset").success)
    renewal.cancel()
    send(0.0)
    until(lambda: beside.call("/lab/reset").success)

    # No topic of the lab's own carries more than the design's list, and that it lives.
    names = {name for name, _ in listener.get_publisher_names_and_types_by_node("lab", "/")}
    assert names <= {topic.name for topic in (*topics.ALL, topics.HEARTBEAT)} | {"/rosout", "/parameter_events"}


SLOW_READER = """
import rclpy
from rclpy.executors import ExternalShutdownException
from sandbot_common import topics
from sandbot_common.ros import endpoints

rclpy.init()
reader, heard, height = rclpy.create_node("slow_reader"), [], []
endpoints.subscription(reader, topics.DORSAL_IMAGE, heard.append)
endpoints.subscription(reader, topics.BED_HEIGHT, height.append)
while not height:
    rclpy.spin_once(reader, timeout_sec=1.0)
print("ready", flush=True)
try:
    while len(heard) < %d:
        rclpy.spin_once(reader, timeout_sec=1.0)
except ExternalShutdownException:
    pass
print(len(heard), flush=True)
"""


def test_frames_wait_for_a_reader_that_stands_still_and_the_legs_do_not(lab, beside, heard):
    legs = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    beside.until(lambda: legs.get_subscription_count() and heard["/bed/height"])
    # Fewer than are sent again, should a busy machine keep the reader still for longer than he is waited for.
    t_s, angles, rates = (values[: 2 * SETPOINTS] for values in setpoints(16.0))
    rates[-1] = 0.0
    wanted = SETPOINTS
    reader = subprocess.Popen([sys.executable, "-c", SLOW_READER % wanted], stdout=subprocess.PIPE, text=True)
    try:
        assert reader.stdout.readline() == "ready\n"
        frames = heard[topics.DORSAL_IMAGE.name]
        reader.send_signal(signal.SIGSTOP)
        t0_ns = beside.node.get_clock().now().nanoseconds
        play(legs, topics.LEGS, t0_ns, t_s, angles, rates)
        beside.until(lambda: len(heard["/leg_states"]) == len(t_s))
        assert len(frames) < wanted / 2  # the legs have come to rest, frames are still to come
        reader.send_signal(signal.SIGCONT)
        beside.until(lambda: len(frames) == wanted)
        assert reader.communicate(timeout=60)[0] == f"{wanted}\n"
    finally:
        reader.kill()
    stamps = [messages.nanoseconds(frame.header.stamp) - t0_ns for frame in frames]
    assert stamps == [k * 10_000_000 for k in range(wanted)]


def test_legs_obey_nobody_while_two_command_them():
    lab, alarms = object.__new__(LabNode), []
    lab._rivals = type("Rivals", (), {"fault": lambda _: "clock and replay both publish /leg_setpoints"})()
    lab._standing = lab._legs_lapsed = False
    lab._setpoints = lab._refused = 0
    lab._trial, lab._alarm, lab._health = None, alarms.append, SimpleNamespace(level=2)
    for rate in (16.0, 0.0):
        lab._on_setpoint(messages.joint_state(1, topics.LEGS, np.ones(6), np.full(6, rate), np.ones(6)))
    assert alarms == ["legs stopped: clock and replay both publish /leg_setpoints"]
    assert (lab._standing, lab._legs_lapsed, lab._refused) == (True, True, 2)


def test_air_obeys_nobody_while_two_command_it_and_then_only_after_a_level_of_zero():
    lab, alarms = object.__new__(LabNode), []
    lab._blowers = SimpleNamespace(fault=lambda: lab.rivals)
    lab._partners, lab._air, lab._health = SimpleNamespace(begin=lambda _: None), Lease(60.0), SimpleNamespace()
    lab._air_lapsed, lab._air_stops, lab._blower, lab.rivals, lab._alarm = False, 0, 0.0, "", alarms.append
    lab._pass_time, lab._bed = lambda: None, SimpleNamespace(set_blower=lambda _: None)

    def blows(level):
        lab._on_blower(messages.float64(level))
        return lab._blower

    assert blows(0.5) == 0.5
    lab.rivals = "bed and stranger both publish /bed/blower"
    assert [blows(level) for level in (0.7, 0.0, 0.7)] == [0.0] * 3
    assert (alarms, lab._air_stops) == (["air off: bed and stranger both publish /bed/blower"], 1)
    lab.rivals = ""
    assert [blows(level) for level in (0.7, 0.0, 0.7)] == [0.0, 0.0, 0.7]


def test_legs_that_come_in_mid_gait_move_when_they_have_been_told_rest(lab, beside, heard):
    told, rate = {}, [16.0]
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, lambda message: told.update(lab=message.status[0]))
    legs = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    beside.node.create_timer(
        0.02,
        lambda: legs.publish(
            messages.joint_state(time.time_ns(), topics.LEGS, np.full(6, 24.0), np.full(6, rate[0]), np.ones(6))
        ),
    )
    beside.until(lambda: "lab" in told and "before they have been told to rest" in told["lab"].message)
    assert not heard["/leg_states"]
    rate[0] = 0.0
    beside.wait(lambda: False, 0.1)
    rate[0] = 16.0
    beside.until(lambda: heard["/leg_states"])


@pytest.mark.parametrize("images", ["true", "false"])
def test_a_lab_without_cameras_leaves_the_pictures_to_others(beside, domain, images):
    command = [sys.executable, "-m", "sandbot_lab.nodes.lab_node", "--ros-args", "-p", f"images:={images}"]
    heights = []
    endpoints.subscription(beside.node, topics.BED_HEIGHT, heights.append)
    process = subprocess.Popen(command)
    try:
        beside.until(lambda: heights)
        filming = [beside.node.count_publishers(view.image.relative) for view in topics.VIEWS.values()]
        assert filming == [1, 1] if images == "true" else filming == [0, 0]
    finally:
        process.terminate()
        process.wait(30)


def no_walk(spoilt):
    """A first set-point that moves, with what no leg can do."""
    message = messages.joint_state(0, topics.LEGS, np.ones(6), np.full(6, 16.0), np.zeros(6))
    for name, values in spoilt.items():
        setattr(message, name, values)
    return message


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        ({"position": [np.nan] * 6}, "not finite"),
        ({"velocity": [np.nan] * 6}, "not finite"),
        ({"velocity": [np.inf] * 6}, "not finite"),
        ({"velocity": [-1e300] * 6}, "would turn at 1e+300 rad/s"),
        ({"position": [1e300] * 6}, "an angle of 1e+300 rad"),
        ({"position": [-1e300] * 6}, "an angle of 1e+300 rad"),
        ({"position": [1.0] * 5}, "6 names, 5 angles, 6 rates"),
        ({"velocity": [16.0]}, "6 names, 6 angles, 1 rates"),
        ({"name": [*topics.LEGS[:5], "tail"]}, "no leg 'rear_right'"),
    ],
)
def test_a_walk_does_not_begin_with_what_no_leg_can_do(lab, beside, heard, spoilt, said):
    told = {}
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, lambda message: told.update(lab=message.status[0]))
    legs = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    beside.until(lambda: legs.get_subscription_count() and heard["/bed/height"])
    t0_ns = beside.node.get_clock().now().nanoseconds
    legs.publish(messages.joint_state(t0_ns - 1, topics.LEGS, np.ones(6), np.zeros(6), np.zeros(6)))
    message = no_walk(spoilt)
    message.header = messages.header(t0_ns, "")
    legs.publish(message)
    beside.until(lambda: "lab" in told and said in told["lab"].message)
    assert not heard["/sync_led"]
    assert not heard["/leg_states"]
    t_s, angles, rates = (values[:SETPOINTS] for values in setpoints(16.0))
    rates[-1] = 0.0
    play(legs, topics.LEGS, t0_ns + 10_000_000, t_s, angles, rates)  # the lab lives, and the next walk is a whole one
    beside.until(lambda: len(heard["/leg_states"]) == SETPOINTS)
    assert len(heard["/sync_led"]) == 1
