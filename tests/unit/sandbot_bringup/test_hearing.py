"""What a campaign makes of what it hears, and what the gate does about it: without a graph."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data

from sandbot_bringup.endings import CampaignEnds
from sandbot_bringup.nodes import gate_node
from sandbot_bringup.nodes.gate_node import Gate
from sandbot_bringup.nodes.hearing_node import RECORDER, STEADY_S, Hearing
from sandbot_common import messages, topics
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.health import CALIBRATION, PROCESS, TIMELESS
from sandbot_common.ros.endpoints import NAMELESS
from sandbot_tracking.calibration import cameras_from_mapping, checksum

TYPES = {topic.relative: topic.type for topic in topics.ALL}
RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


class Node:
    """Hears nothing by itself; ``publishers``: the names of the nodes that publish a topic, if it is not one;
    ``offers``: how they do, if not as they should."""

    def __init__(self):
        self.publishers, self.offers = {}, {}

    def create_subscription(self, *_, **__):
        pass

    def count_publishers(self, name):
        return len(self.publishers.get(name, ["one"]))

    def get_publishers_info_by_topic(self, name):
        offers = {"topic_type": TYPES[name], "qos_profile": RELIABLE, **self.offers.get(name, {})}
        names = self.publishers.get(name, ["one"])
        return [SimpleNamespace(node_name=node, endpoint_gid=[0], **offers) for node in names]


@pytest.fixture
def node():
    return Node()


@pytest.fixture
def hearing(node):
    return Hearing(node, 1.0, 0.02)


def tell_legs(hearing, rate):
    six = np.zeros(6)
    hearing._on_legs(messages.joint_state(1, topics.LEGS, six, six + rate, six))


def test_no_trial_begins_while_legs_say_that_they_move(hearing, node):
    gate = Gate(node, hearing, None, lambda condition, _: condition())
    gate._pace = gate._has_one_publisher = lambda *_: pytest.fail("it went on")
    hearing.missing = list
    tell_legs(hearing, 8.0)
    with pytest.raises(CampaignEnds, match=r"legs do not come to rest \(/leg_states\)"):
        gate.before_trial(None, None)


@pytest.mark.parametrize(("rates", "moving"), [([], True), ([np.nan], True), ([0.0, -1.0], True), ([0.0] * 6, False)])
def test_legs_rest_only_when_their_rates_say_so(hearing, rates, moving):
    six = np.zeros(6)
    hearing._on_legs(messages.joint_state(1, topics.LEGS, six, np.array(rates), six))
    assert hearing.moving == moving


@pytest.mark.parametrize(
    ("topic", "offered", "said"),
    [
        (
            topics.LEG_STATES,
            {"topic_type": "std_msgs/msg/String"},
            "as std_msgs/msg/String, not sensor_msgs/msg/JointState",
        ),
        (topics.LEG_SETPOINTS, {"qos_profile": qos_profile_sensor_data}, "best effort, not reliable"),
        (topics.LEG_STATES, {"qos_profile": qos_profile_sensor_data}, ""),  # as drivers of sensors are wont to
    ],
)
def test_what_a_stranger_publishes_in_vain_is_named_before_anything_moves(
    hearing, node, tmp_path, topic, offered, said
):
    node.offers[topic.relative], node.publishers[topic.relative] = offered, ["rig"]
    gate = Gate(node, hearing, None, lambda condition, _: condition())
    gate._pace = gate._same_cameras = lambda _: None
    hearing.missing = list
    if not said:
        gate.before_trial(None, SimpleNamespace(path=tmp_path))
        return
    with pytest.raises(CampaignEnds, match=f"rig publishes {topic.name} {said}; fix it"):
        gate.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["bed", "replay"], "bed and replay both publish /bed/volume_fraction"),
        (["bed", "bed"], ""),  # one of them was killed, or is about to be refused
        (["bed", NAMELESS], ""),  # one has just started, or is being forgotten
        ([], ""),
    ],
)
def test_two_nodes_that_publish_what_a_row_is_made_of_end_trial_and_campaign(hearing, node, tmp_path, names, said):
    node.publishers[topics.BED_PHI.relative] = names
    node.publishers[topics.SPEED.relative] = ["tracker", "rosbag2_player"]  # no row is made of it
    assert hearing.fault() == said
    gate = Gate(node, hearing, None, lambda condition, _: condition())
    gate._pace = gate._same_cameras = lambda _: None
    hearing.missing = list
    folder = SimpleNamespace(path=tmp_path)
    if not said:
        gate.before_trial(None, folder)
        return
    with pytest.raises(CampaignEnds, match=said):
        gate.before_trial(None, folder)


def test_who_rests_or_died_in_the_middle_of_a_walk_does_not_say_that_he_moves(hearing):
    tell_legs(hearing, 8.0)
    assert hearing.reports_motion
    hearing._listening.now_s += 2 * STEADY_S
    assert not hearing.reports_motion
    tell_legs(hearing, 0.0)
    assert not hearing.reports_motion


@pytest.mark.parametrize(("said", "height_m"), [("0.102", 0.102), ("abc", np.nan), ("", np.nan)])
def test_a_status_that_is_no_number_ends_no_campaign(hearing, said, height_m):
    hearing._on_bed(messages.diagnostics(0, "bed", {"stage": "ready", "height_m": said}))
    np.testing.assert_equal(hearing.bed_height_m, height_m)
    assert hearing.bed_stage == "ready"
    hearing._on_diagnostics(messages.diagnostics(0, RECORDER, {"written": said}))
    assert (hearing.recorded > 0) is (height_m > 0)


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


def test_a_tracker_that_is_blind_ends_the_trial(hearing):
    """Legs walked on for seconds, and the trial was lost all the same."""
    tell = messages.diagnostics
    hearing._on_diagnostics(tell(1, "tracker", {}, level=1, text="dorsal: the image is frozen"))
    assert not hearing.fault()
    hearing._on_diagnostics(tell(1, "tracker", {}, level=2, text="dorsal: frames of 320x240 px"))
    assert hearing.fault() == "the tracker is blind: dorsal: frames of 320x240 px"
    hearing._on_diagnostics(tell(1, "tracker", {}, level=2, text="ended: SIGINT"))
    assert hearing.unplugged() == []


def film(hearing, dorsal, lateral, period_ms=10.0):
    """0.2 s pass, and the tracker tells how many new frames it has had, as with every health of it."""
    hearing._listening.now_s += 0.2
    for who, topic in (("clock", topics.LEG_SETPOINTS), ("robot", topics.LEG_STATES), ("bed", topics.BED_STATUS)):
        hearing._heard(who, topic)
    figures = {"dorsal_frames": dorsal, "lateral_frames": lateral}
    figures |= {f"{view}_calibrated_ms": period_ms for view in topics.VIEWS}
    hearing._on_diagnostics(messages.diagnostics(1, "tracker", figures))
    hearing._heard("tracker", topics.SPEED)


@pytest.mark.parametrize("idle", [True, False], ids=["films at rest, too", "films from the walk on"])
def test_any_camera_that_falls_silent_in_the_walk_ends_the_trial(hearing, idle):
    """One whose driver reports no health had the legs walk on for five seconds."""
    film(hearing, 100, 100)
    hearing.require(["tracker"])
    for number in range(10):  # of the preparation, while nothing moves
        film(hearing, 100 + 20 * idle * number, 100 + 20 * idle * number)
    hearing.watch_walking()
    for number in range(10):
        film(hearing, 400 + 20 * number, 400 + 20 * number)
        assert not hearing.fault()
    silent = 0
    while not hearing.fault():
        silent += 1
        film(hearing, 600 + 20 * silent, 580)
    assert hearing.fault() == "the lateral camera is silent: no new frame for 1 s"
    assert silent in (5, 6)
    hearing.watch()  # legs are at rest
    film(hearing, 1000, 580)
    assert not hearing.fault()


def test_a_slow_camera_is_not_taken_for_a_silent_one(hearing):
    hearing.require(["tracker"])
    hearing.watch_walking()
    for number in range(40):  # a frame every 1.4 s, of 0.8 Hz by its calibration: one late, none missing
        film(hearing, number // 7, number // 7, period_ms=1250.0)
        assert not hearing.fault()
    for _ in range(20):
        film(hearing, 5, 5, period_ms=1250.0)
    assert hearing.fault() == "the dorsal camera is silent: no new frame for 3.75 s"


@pytest.mark.parametrize("waited_s", [0.0, 0.2])
def test_frames_that_wait_while_the_tracker_has_no_cpu_are_no_silence(hearing, waited_s):
    hearing.require(["tracker"])
    hearing.watch_walking()
    film(hearing, 20, 20)
    hearing._neighbours.look = lambda _: {"tracker": waited_s}
    for _ in range(8):
        hearing.listen()
        film(hearing, 20, 20)
    assert bool(hearing.fault()) is (waited_s == 0.0)


def test_the_virtual_labs_cameras_may_wait_for_their_cpu(hearing, node):
    node.publishers |= {view.image.relative: ["lab"] for view in topics.VIEWS.values()}
    hearing.require(["tracker"])
    hearing.watch_walking()
    film(hearing, 20, 20)
    for _ in range(20):
        film(hearing, 20, 20)
        assert not hearing.fault()


@pytest.mark.parametrize("tracked", ["the same", "another", "by a third party's tracker"])
def test_the_tracker_must_measure_by_the_calibration_that_bags_state(hearing, node, tmp_path, tracked):
    gate = Gate(node, hearing, None, lambda condition, _: condition())
    gate._pace = lambda _: None
    hearing.missing = list
    path, content = tmp_path / "cameras.yaml", yaml.safe_load(config_file("cameras.yaml").read_text())
    path.write_text(yaml.safe_dump(content))
    content["lateral"]["fx"] *= 1.05 if tracked == "another" else 1.0
    own = {} if "third" in tracked else {CALIBRATION: checksum(cameras_from_mapping(content, "cameras"))}
    hearing._on_diagnostics(messages.diagnostics(1, "tracker", own))
    if tracked != "another":
        gate.before_trial(None, SimpleNamespace(path=tmp_path))
        return
    with pytest.raises(CampaignEnds, match=f"another calibration than {path}; start it with cameras:={path}"):
        gate.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize("level", [0, 2])
def test_who_has_lost_a_device_is_not_told_to_start_its_driver(hearing, node, level):
    gate = Gate(node, hearing, SimpleNamespace(is_offered=lambda _: True), lambda condition, _: condition())
    gate._pace = gate._has_one_publisher = lambda *_: pytest.fail("it went on")
    hearing._on_diagnostics(messages.diagnostics(1, "serial_bed", {}, level=level, text="only noise"))
    lost = "the serial_bed has lost its device: only noise; fix it"
    with pytest.raises(InputError) as no_reading:
        gate.find_nodes()
    with pytest.raises(CampaignEnds) as no_trial:
        gate.before_trial(None, None)
    for error, absent in ((no_reading, "bed node has no reading"), (no_trial, "clock is stuck")):
        assert str(error.value).startswith(lost if level else f"the {absent}")
        assert ("start the nodes with" in str(error.value)) is not bool(level)


def test_legs_that_somebody_else_moves_end_the_trial(hearing):
    tell_legs(hearing, 8.0)
    assert hearing.fault() == "legs move that the campaign did not start (/leg_states)"
    hearing.may_move = True
    assert not hearing.fault()
    hearing.forget_trial()
    assert hearing.fault()
    tell_legs(hearing, 0.0)
    assert not hearing.fault()


@pytest.mark.parametrize(("stage", "number"), [("fluidise", "5"), ("ready", "5"), ("idle", "4")])
def test_a_bed_that_somebody_else_prepares_ends_the_trial(hearing, stage, number):
    def reports(stage, number):
        hearing._on_bed(messages.diagnostics(1, "bed", {"stage": stage, "preparation": number}))
        return hearing.fault()

    assert not reports("pulse", "4")
    hearing.prepared = "ready", "4"
    assert not reports("ready", "4")
    assert reports(stage, number) == f"the bed is in {stage}, which the campaign did not ask for (/bed/status)"
    hearing.forget_trial()
    assert not hearing.fault()


@pytest.mark.parametrize("prepared", [None, ("ready", "4")])
def test_a_second_bed_that_is_about_to_be_refused_changes_nothing(hearing, node, prepared):
    def reports(stage, number):
        hearing._on_bed(messages.diagnostics(1, "bed", {"stage": stage, "preparation": number}))
        return hearing.bed_stage, hearing.bed_preparation

    assert reports("ready", "4") == ("ready", "4")
    hearing.prepared = prepared
    node.publishers[topics.BED_STATUS.relative] = ["bed", "bed"]
    assert reports("idle", "0") == ("ready", "4")
    assert not hearing.fault()
    assert reports("fluidise", "5") == ("fluidise", "5")
    node.publishers.clear()
    assert reports("idle", "0") == ("idle", "0")


@pytest.mark.parametrize("full", [True, False])
def test_no_trial_begins_whose_recorder_could_not_be_heard_for_full_shared_memory(
    hearing, node, tmp_path, monkeypatch, full
):
    def check():
        if full:
            raise InputError("/dev/shm is full")

    monkeypatch.setattr(gate_node, "check_room", check)
    gate = Gate(node, hearing, None, lambda condition, _: condition())
    gate._pace = gate._same_cameras = lambda _: None
    hearing.missing = list
    with pytest.raises(CampaignEnds, match="/dev/shm is full, then start") if full else nullcontext():
        gate.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize("who", ["tracker", "campaign", "scene"])
def test_no_trial_begins_whose_stamps_would_show_1970(hearing, node, tmp_path, who):
    hearing._on_diagnostics(messages.diagnostics(0, who, {TIMELESS: "nobody publishes /clock"}, level=1))
    gate = Gate(node, hearing, None, lambda condition, _: condition())
    gate._pace = gate._same_cameras = lambda _: None
    hearing.missing = list
    told = (
        nullcontext() if who == "scene" else pytest.raises(CampaignEnds, match=f"{who}: nobody publishes /clock; set")
    )
    with told:
        gate.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize(
    ("offered", "said"),
    [
        (False, "no node offers /robot1/clock/start in ROS_DOMAIN_ID 72"),
        (True, "no node publishes /robot1/leg_states in"),
    ],
)
def test_where_no_node_was_found_is_told(hearing, node, offered, said):
    """Nodes may run in another domain or namespace."""
    node.publishers[topics.LEG_STATES.relative] = []
    node.get_namespace, node.context = lambda: "/robot1", SimpleNamespace(get_domain_id=lambda: 72)
    orders = SimpleNamespace(is_offered=lambda _: offered)
    with pytest.raises(InputError, match=f"{said}.*; start the nodes with: ros2 launch"):
        Gate(node, hearing, orders, lambda condition, _: condition()).find_nodes()


@pytest.mark.parametrize(
    ("lossless_s", "free_mib", "needed_mib"), [(0.0, 299, 300), (20.0, 1400, 1471), (20.0, 1472, 0)]
)
def test_no_trial_begins_whose_film_would_fill_the_disk(
    hearing, node, tmp_path, monkeypatch, lossless_s, free_mib, needed_mib
):
    """Two cameras of 640x480 px at 100 Hz: 58.6 MiB a second."""
    monkeypatch.setattr(gate_node.shutil, "disk_usage", lambda _: SimpleNamespace(free=free_mib << 20))
    monkeypatch.setattr(gate_node, "check_room", lambda: None)
    (tmp_path / "cameras.yaml").write_text(config_file("cameras.yaml").read_text())
    gate = Gate(node, hearing, None, lambda condition, _: condition())
    gate._pace = gate._same_cameras = lambda _: None
    hearing.missing = list
    said = f"only {free_mib} MiB free, the next trial needs {needed_mib}"
    with pytest.raises(CampaignEnds, match=said) if needed_mib else nullcontext():
        gate.before_trial(None, SimpleNamespace(path=tmp_path), lossless_s)
