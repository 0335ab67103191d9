"""The tracker as a real process: a robot that /trial tells moves the plane in which its markers are."""

import json
import signal
import subprocess
import sys

import numpy as np
import pytest
import yaml
from rclpy.qos import qos_profile_sensor_data

from sandbot_bringup.config import config_folder
from sandbot_common import messages, topics
from sandbot_common.robot import Robot, to_mapping
from sandbot_common.ros import endpoints
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.cameras import LabCamera
from sandbot_tracking.nodes import tracker_node

pytestmark = pytest.mark.ros

PERIOD_NS = 10_000_000
X_M, Z_M = 0.3, 0.05
HIGH = Robot(leg_radius_m=0.05, axle_height_m=Z_M)
"""A robot whose axles are as high when it lies: the body has not risen, where SandBot's would have by 25 mm."""


@pytest.fixture
def tracker(domain):
    process = subprocess.Popen(
        [sys.executable, "-c", "from sandbot_tracking.nodes.tracker_node import main; raise SystemExit(main())"]
    )
    yield process
    process.terminate()
    assert process.wait(30) in (0, -signal.SIGTERM)


def test_cameras_without_a_dorsal_one_are_refused_in_one_line(domain, tmp_path, capfd):
    file = tmp_path / "lateral-only.yaml"
    file.write_text(yaml.safe_dump({"lateral": read_yaml(config_folder() / "cameras.yaml")["lateral"]}))
    assert tracker_node.main(["--ros-args", "-p", f"cameras:={file}"]) == 2
    assert capfd.readouterr().err.endswith(f"error: {file}: no 'dorsal' camera in it\n")


def test_a_camera_is_blind_once_no_frame_could_be_used_for_a_while():
    unusable = tracker_node.Unusable()
    unusable.add("dorsal", "dorsal: 0 bytes are not a picture", 1.0)
    unusable.used("dorsal")
    unusable.add("dorsal", "dorsal: 0 bytes are not a picture", 9.0)  # one in a while is damaged
    assert unusable.blind == ""
    unusable.add("lateral", "lateral: frames of 320x240 px", 9.0)
    unusable.add("lateral", "lateral: frames of 320x240 px", 9.0 + tracker_node._BLIND_S)
    assert unusable.blind == "lateral: frames of 320x240 px"
    unusable.used("lateral")
    assert unusable.blind == ""


def test_a_tracker_tells_of_a_camera_whose_frames_it_cannot_use(tracker, beside):
    sections, told = read_yaml(config_folder() / "cameras.yaml"), []
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, lambda message: told.extend(message.status))
    image = endpoints.publisher(beside.node, topics.DORSAL_IMAGE)
    beside.until(image.get_subscription_count)
    camera = LabCamera("dorsal", sections["dorsal"], 3, HIGH)

    def says(every, level, text):
        frame = np.ascontiguousarray(camera.render(X_M, Z_M)[::every, ::every])
        told.clear()
        image.publish(messages.image(beside.node.get_clock().now().nanoseconds, "dorsal", frame))
        beside.wait(lambda: told, 0.2)
        return bool(told) and told[-1].level[0] == level and text in told[-1].message

    small = "dorsal: frames of 320x240 px, but it is calibrated for 640x480"
    beside.until(lambda: says(2, 2, small))
    beside.until(lambda: says(1, 1, small))  # until the next trial begins
    assert tracker.poll() is None


def test_a_robot_that_sends_best_effort_is_heard(tracker, beside):
    for topic in (topics.LEG_STATES, topics.SYNC_LED):
        kind, name = messages.message_class(topic.type), topic.relative
        offered = beside.node.create_publisher(kind, name, qos_profile_sensor_data)
        beside.until(offered.get_subscription_count)
        beside.node.destroy_publisher(offered)
        beside.until(endpoints.publisher(beside.node, topic).get_subscription_count)  # and one that is reliable


def test_the_robot_that_a_trial_tells_is_tracked(tracker, beside):
    sections = read_yaml(config_folder() / "cameras.yaml")
    shown = ((topics.DORSAL_IMAGE, "dorsal"), (topics.LATERAL_IMAGE, "lateral"))
    images = {name: endpoints.publisher(beside.node, topic) for topic, name in shown}
    views = {name: LabCamera(name, sections[name], 3, HIGH) for name in images}
    trial, legs = (endpoints.publisher(beside.node, topic) for topic in (topics.TRIAL, topics.LEG_STATES))
    places = []
    endpoints.subscription(beside.node, topics.COM, lambda com: places.append(com.point.x))
    beside.until(lambda: all(one.get_subscription_count() for one in (*images.values(), trial, legs)))
    now_ns, zero = beside.node.get_clock().now().nanoseconds, np.zeros(6)
    stamps = iter(range(now_ns, now_ns + 10**12, PERIOD_NS))

    def seen_at(x_m):
        places.clear()
        # A frame from above is joined with those from the side before and after it.
        for stamp in (next(stamps), next(stamps)):
            legs.publish(messages.joint_state(stamp, topics.LEGS, zero, zero, zero))
            for name, publisher in images.items():
                publisher.publish(messages.image(stamp, name, views[name].render(X_M, Z_M)))
        beside.wait(lambda: places, 5.0)
        assert tracker.poll() is None, "the tracker has gone"
        return bool(places) and places[-1] == pytest.approx(x_m, abs=5e-4)

    # A body that has risen by 25 mm is nearer to the camera: what it sees at the same place is further in.
    camera_x, _, camera_z = sections["dorsal"]["position_m"]
    top = sections["dorsal"]["plane"]["offset_m"]
    risen = camera_x + (X_M - camera_x) * (camera_z - top - 0.025) / (camera_z - top)
    beside.until(lambda: seen_at(risen))
    trial.publish(messages.string(json.dumps({"robot": to_mapping(HIGH)})))
    beside.until(lambda: seen_at(X_M))
    for told in ({"leg_radius_m": 9999.0}, {}):
        trial.publish(messages.string(json.dumps({"robot": told})))
    beside.until(lambda: seen_at(risen))
