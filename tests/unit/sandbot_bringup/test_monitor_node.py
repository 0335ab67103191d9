"""The state of the nodes as a campaign sees it, and its preflight checks: without a graph."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data

from sandbot_bringup.endings import CampaignEnds
from sandbot_bringup.nodes import preflight_node
from sandbot_bringup.nodes.monitor_node import RECORDER, STEADY_S, Monitor
from sandbot_bringup.nodes.preflight_node import Preflight
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
def monitor(node):
    return Monitor(node, 1.0, 0.02)


def tell_legs(monitor, rate):
    six = np.zeros(6)
    monitor._on_legs(messages.joint_state(1, topics.LEGS, six, six + rate, six))


def test_no_trial_begins_while_legs_say_that_they_move(monitor, node):
    preflight = Preflight(node, monitor, None, lambda condition, _: condition())
    preflight._pace = preflight._has_one_publisher = lambda *_: pytest.fail("it went on")
    monitor.missing = list
    tell_legs(monitor, 8.0)
    with pytest.raises(CampaignEnds, match=r"legs do not come to rest \(/leg_states\)"):
        preflight.before_trial(None, None)


@pytest.mark.parametrize(("rates", "moving"), [([], True), ([np.nan], True), ([0.0, -1.0], True), ([0.0] * 6, False)])
def test_legs_rest_only_when_their_rates_say_so(monitor, rates, moving):
    six = np.zeros(6)
    monitor._on_legs(messages.joint_state(1, topics.LEGS, six, np.array(rates), six))
    assert monitor.moving == moving


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
    monitor, node, tmp_path, topic, offered, said
):
    node.offers[topic.relative], node.publishers[topic.relative] = offered, ["rig"]
    preflight = Preflight(node, monitor, None, lambda condition, _: condition())
    preflight._pace = preflight._same_cameras = lambda _: None
    monitor.missing = list
    if not said:
        preflight.before_trial(None, SimpleNamespace(path=tmp_path))
        return
    with pytest.raises(CampaignEnds, match=f"rig publishes {topic.name} {said}; fix it"):
        preflight.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["bed", "replay"], "bed and replay both publish /bed/volume_fraction"),
        (["bed", "bed"], ""),  # one of them was killed, or is about to be refused
        (["bed", NAMELESS], ""),  # one has just started, or is being forgotten
        ([], ""),
    ],
)
def test_two_nodes_that_publish_what_a_row_is_made_of_end_trial_and_campaign(monitor, node, tmp_path, names, said):
    node.publishers[topics.BED_PHI.relative] = names
    node.publishers[topics.SPEED.relative] = ["tracker", "rosbag2_player"]  # no row is made of it
    assert monitor.fault() == said
    preflight = Preflight(node, monitor, None, lambda condition, _: condition())
    preflight._pace = preflight._same_cameras = lambda _: None
    monitor.missing = list
    folder = SimpleNamespace(path=tmp_path)
    if not said:
        preflight.before_trial(None, folder)
        return
    with pytest.raises(CampaignEnds, match=said):
        preflight.before_trial(None, folder)


def test_who_rests_or_died_in_the_middle_of_a_walk_does_not_say_that_he_moves(monitor):
    tell_legs(monitor, 8.0)
    assert monitor.reports_motion
    monitor._listening.now_s += 2 * STEADY_S
    assert not monitor.reports_motion
    tell_legs(monitor, 0.0)
    assert not monitor.reports_motion


@pytest.mark.parametrize(("said", "height_m"), [("0.102", 0.102), ("abc", np.nan), ("", np.nan)])
def test_a_status_that_is_no_number_ends_no_campaign(monitor, said, height_m):
    monitor._on_bed(messages.diagnostics(0, "bed", {"stage": "ready", "height_m": said}))
    np.testing.assert_equal(monitor.bed_height_m, height_m)
    assert monitor.bed_stage == "ready"
    monitor._on_diagnostics(messages.diagnostics(0, RECORDER, {"written": said}))
    assert (monitor.recorded > 0) is (height_m > 0)


def test_another_recorder_is_not_taken_for_our_own(monitor):
    def says(pid, text, level=0):
        told = {PROCESS: f"host {pid} 77"}
        monitor._on_diagnostics(messages.diagnostics(1, RECORDER, told, level=level, text=text))

    monitor.expect_recorder(42)
    says(41, "ok")
    assert not monitor.heard_since(RECORDER, -1.0)
    says(42, "ok")
    monitor.require_recorder()
    says(41, "ended: SIGINT", level=2)
    assert monitor.statuses[RECORDER][:2] == (0, "ok")
    assert not monitor.fault()
    says(42, "ended: SIGTERM", level=2)
    assert monitor.fault() == "the recorder ended: SIGTERM"


@pytest.mark.parametrize("driver", ["serial_legs", "lateral_camera"])
def test_a_driver_whose_cable_is_out_ends_the_trial(monitor, driver):
    monitor._on_diagnostics(messages.diagnostics(1, driver, {}, level=2, text="the device gives no frames"))
    assert monitor.fault() == f"the {driver} has lost its device: the device gives no frames"
    monitor._on_diagnostics(messages.diagnostics(1, driver, {}))
    assert not monitor.fault()


def test_a_tracker_that_is_blind_ends_the_trial(monitor):
    """Legs walked on for seconds, and the trial was lost all the same."""
    tell = messages.diagnostics
    monitor._on_diagnostics(tell(1, "tracker", {}, level=1, text="dorsal: the image is frozen"))
    assert not monitor.fault()
    monitor._on_diagnostics(tell(1, "tracker", {}, level=2, text="dorsal: frames of 320x240 px"))
    assert monitor.fault() == "the tracker is blind: dorsal: frames of 320x240 px"
    monitor._on_diagnostics(tell(1, "tracker", {}, level=2, text="ended: SIGINT"))
    assert monitor.unplugged() == []


def film(monitor, dorsal, lateral, period_ms=10.0):
    """0.2 s pass, and the tracker tells how many new frames it has had, as with every health of it."""
    monitor._listening.now_s += 0.2
    for who, topic in (("clock", topics.LEG_SETPOINTS), ("robot", topics.LEG_STATES), ("bed", topics.BED_STATUS)):
        monitor._heard(who, topic)
    figures = {"dorsal_frames": dorsal, "lateral_frames": lateral}
    figures |= {f"{view}_calibrated_ms": period_ms for view in topics.VIEWS}
    monitor._on_diagnostics(messages.diagnostics(1, "tracker", figures))
    monitor._heard("tracker", topics.SPEED)


@pytest.mark.parametrize("idle", [True, False], ids=["films at rest, too", "films from the walk on"])
def test_any_camera_that_falls_silent_in_the_walk_ends_the_trial(monitor, idle):
    """One whose driver reports no health had the legs walk on for five seconds."""
    film(monitor, 100, 100)
    monitor.require(["tracker"])
    for number in range(10):  # of the preparation, while nothing moves
        film(monitor, 100 + 20 * idle * number, 100 + 20 * idle * number)
    monitor.watch_walking()
    for number in range(10):
        film(monitor, 400 + 20 * number, 400 + 20 * number)
        assert not monitor.fault()
    silent = 0
    while not monitor.fault():
        silent += 1
        film(monitor, 600 + 20 * silent, 580)
    assert monitor.fault() == "the lateral camera is silent: no new frame for 1 s"
    assert silent in (5, 6)
    monitor.watch()  # legs are at rest
    film(monitor, 1000, 580)
    assert not monitor.fault()


def test_a_slow_camera_is_not_taken_for_a_silent_one(monitor):
    monitor.require(["tracker"])
    monitor.watch_walking()
    for number in range(40):  # a frame every 1.4 s, of 0.8 Hz by its calibration: one late, none missing
        film(monitor, number // 7, number // 7, period_ms=1250.0)
        assert not monitor.fault()
    for _ in range(20):
        film(monitor, 5, 5, period_ms=1250.0)
    assert monitor.fault() == "the dorsal camera is silent: no new frame for 3.75 s"


@pytest.mark.parametrize("waited_s", [0.0, 0.2])
def test_frames_that_wait_while_the_tracker_has_no_cpu_are_no_silence(monitor, waited_s):
    monitor.require(["tracker"])
    monitor.watch_walking()
    film(monitor, 20, 20)
    monitor._neighbours.look = lambda _: {"tracker": waited_s}
    for _ in range(8):
        monitor.listen()
        film(monitor, 20, 20)
    assert bool(monitor.fault()) is (waited_s == 0.0)


def test_the_virtual_labs_cameras_may_wait_for_their_cpu(monitor, node):
    node.publishers |= {view.image.relative: ["lab"] for view in topics.VIEWS.values()}
    monitor.require(["tracker"])
    monitor.watch_walking()
    film(monitor, 20, 20)
    for _ in range(20):
        film(monitor, 20, 20)
        assert not monitor.fault()


@pytest.mark.parametrize("tracked", ["the same", "another", "by a third party's tracker"])
def test_the_tracker_must_measure_by_the_calibration_that_bags_state(monitor, node, tmp_path, tracked):
    preflight = Preflight(node, monitor, None, lambda condition, _: condition())
    preflight._pace = lambda _: None
    monitor.missing = list
    path, content = tmp_path / "cameras.yaml", yaml.safe_load(config_file("cameras.yaml").read_text())
    path.write_text(yaml.safe_dump(content))
    content["lateral"]["fx"] *= 1.05 if tracked == "another" else 1.0
    own = {} if "third" in tracked else {CALIBRATION: checksum(cameras_from_mapping(content, "cameras"))}
    monitor._on_diagnostics(messages.diagnostics(1, "tracker", own))
    if tracked != "another":
        preflight.before_trial(None, SimpleNamespace(path=tmp_path))
        return
    with pytest.raises(CampaignEnds, match=f"another calibration than {path}; start it with cameras:={path}"):
        preflight.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize("level", [0, 2])
def test_who_has_lost_a_device_is_not_told_to_start_its_driver(monitor, node, level):
    preflight = Preflight(node, monitor, SimpleNamespace(is_offered=lambda _: True), lambda condition, _: condition())
    preflight._pace = preflight._has_one_publisher = lambda *_: pytest.fail("it went on")
    monitor._on_diagnostics(messages.diagnostics(1, "serial_bed", {}, level=level, text="only noise"))
    lost = "the serial_bed has lost its device: only noise; fix it"
    with pytest.raises(InputError) as no_reading:
        preflight.find_nodes()
    with pytest.raises(CampaignEnds) as no_trial:
        preflight.before_trial(None, None)
    for error, absent in ((no_reading, "bed node has no reading"), (no_trial, "clock is stuck")):
        assert str(error.value).startswith(lost if level else f"the {absent}")
        assert ("start the nodes with" in str(error.value)) is not bool(level)


def test_legs_that_somebody_else_moves_end_the_trial(monitor):
    tell_legs(monitor, 8.0)
    assert monitor.fault() == "legs move that the campaign did not start (/leg_states)"
    monitor.may_move = True
    assert not monitor.fault()
    monitor.forget_trial()
    assert monitor.fault()
    tell_legs(monitor, 0.0)
    assert not monitor.fault()


@pytest.mark.parametrize(("stage", "number"), [("fluidise", "5"), ("ready", "5"), ("idle", "4")])
def test_a_bed_that_somebody_else_prepares_ends_the_trial(monitor, stage, number):
    def reports(stage, number):
        monitor._on_bed(messages.diagnostics(1, "bed", {"stage": stage, "preparation": number}))
        return monitor.fault()

    assert not reports("pulse", "4")
    monitor.prepared = "ready", "4"
    assert not reports("ready", "4")
    assert reports(stage, number) == f"the bed is in {stage}, which the campaign did not ask for (/bed/status)"
    monitor.forget_trial()
    assert not monitor.fault()


@pytest.mark.parametrize("prepared", [None, ("ready", "4")])
def test_a_second_bed_that_is_about_to_be_refused_changes_nothing(monitor, node, prepared):
    def reports(stage, number):
        monitor._on_bed(messages.diagnostics(1, "bed", {"stage": stage, "preparation": number}))
        return monitor.bed_stage, monitor.bed_preparation

    assert reports("ready", "4") == ("ready", "4")
    monitor.prepared = prepared
    node.publishers[topics.BED_STATUS.relative] = ["bed", "bed"]
    assert reports("idle", "0") == ("ready", "4")
    assert not monitor.fault()
    assert reports("fluidise", "5") == ("fluidise", "5")
    node.publishers.clear()
    assert reports("idle", "0") == ("idle", "0")


@pytest.mark.parametrize("full", [True, False])
def test_no_trial_begins_whose_recorder_could_not_be_heard_for_full_shared_memory(
    monitor, node, tmp_path, monkeypatch, full
):
    def check():
        if full:
            raise InputError("/dev/shm is full")

    monkeypatch.setattr(preflight_node, "check_room", check)
    preflight = Preflight(node, monitor, None, lambda condition, _: condition())
    preflight._pace = preflight._same_cameras = lambda _: None
    monitor.missing = list
    with pytest.raises(CampaignEnds, match="/dev/shm is full, then start") if full else nullcontext():
        preflight.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize("who", ["tracker", "campaign", "scene"])
def test_no_trial_begins_whose_stamps_would_show_1970(monitor, node, tmp_path, who):
    monitor._on_diagnostics(messages.diagnostics(0, who, {TIMELESS: "nobody publishes /clock"}, level=1))
    preflight = Preflight(node, monitor, None, lambda condition, _: condition())
    preflight._pace = preflight._same_cameras = lambda _: None
    monitor.missing = list
    told = (
        nullcontext() if who == "scene" else pytest.raises(CampaignEnds, match=f"{who}: nobody publishes /clock; set")
    )
    with told:
        preflight.before_trial(None, SimpleNamespace(path=tmp_path))


@pytest.mark.parametrize(
    ("offered", "said"),
    [
        (False, "no node offers /robot1/clock/start in ROS_DOMAIN_ID 72"),
        (True, "no node publishes /robot1/leg_states in"),
    ],
)
def test_where_no_node_was_found_is_told(monitor, node, offered, said):
    """Nodes may run in another domain or namespace."""
    node.publishers[topics.LEG_STATES.relative] = []
    node.get_namespace, node.context = lambda: "/robot1", SimpleNamespace(get_domain_id=lambda: 72)
    services = SimpleNamespace(is_offered=lambda _: offered)
    with pytest.raises(InputError, match=f"{said}.*; start the nodes with: ros2 launch"):
        Preflight(node, monitor, services, lambda condition, _: condition()).find_nodes()


@pytest.mark.parametrize(
    ("lossless_s", "free_mib", "needed_mib"), [(0.0, 299, 300), (20.0, 1400, 1471), (20.0, 1472, 0)]
)
def test_no_trial_begins_whose_film_would_fill_the_disk(
    monitor, node, tmp_path, monkeypatch, lossless_s, free_mib, needed_mib
):
    """Two cameras of 640x480 px at 100 Hz: 58.6 MiB a second."""
    monkeypatch.setattr(preflight_node.shutil, "disk_usage", lambda _: SimpleNamespace(free=free_mib << 20))
    monkeypatch.setattr(preflight_node, "check_room", lambda: None)
    (tmp_path / "cameras.yaml").write_text(config_file("cameras.yaml").read_text())
    preflight = Preflight(node, monitor, None, lambda condition, _: condition())
    preflight._pace = preflight._same_cameras = lambda _: None
    monitor.missing = list
    said = f"only {free_mib} MiB free, the next trial needs {needed_mib}"
    with pytest.raises(CampaignEnds, match=said) if needed_mib else nullcontext():
        preflight.before_trial(None, SimpleNamespace(path=tmp_path), lossless_s)
