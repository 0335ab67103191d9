"""What RViz is shown: bed, robot and marks where they were measured, and nothing that was not."""

import subprocess
import sys

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sandbot_bringup import scene
from sandbot_bringup.config import config_folder
from sandbot_bringup.scene_messages import marker_array
from sandbot_common import messages, topics
from sandbot_common.robot import SANDBOT
from sandbot_common.ros import endpoints
from sandbot_tracking.calibration import read_cameras

NAN = np.full(3, np.nan)
FLAT = {"com": np.array([0.3, 0.0, 0.12]), "front_axle": np.array([0.4, -0.1, 0.03]),
        "rear_axle": np.array([0.2, -0.1, 0.03])}  # fmt: skip
STANDING = dict.fromkeys(SANDBOT.leg_order, 0.0)


def turned(pose, points):
    """Points of a frame in the trackway frame, by the quaternion's own product."""
    x, y, z, w = pose.turn
    axis = np.array([x, y, z])
    return pose.at_m + points + 2 * np.cross(axis, np.cross(axis, points) + w * points)


def groups(marks_m, angles=STANDING, **options):
    return [shape.group for shape in scene.scene(SANDBOT, marks_m, angles, 0.6, blows=False, **options)]


@given(st.lists(st.floats(-np.pi / 2, np.pi / 2), min_size=3, max_size=3))
@example([0.0, 0.0, 2e-6])
def test_a_quaternion_turns_as_its_matrix_does(vector):
    matrix = cv2.Rodrigues(np.array(vector))[0]
    points = np.array([[1.0, 0.0, 0.0], [0.3, -0.2, 0.9]])
    pose = scene.Pose(np.zeros(3), scene.quaternion(matrix))
    np.testing.assert_allclose(turned(pose, points), points @ matrix.T, atol=1e-9)


@pytest.mark.parametrize("name", ["dorsal", "lateral"])
def test_an_optical_frame_is_where_its_camera_looks_from(name):
    """A point of the optical frame (x right, y down, z forward) is seen where the pinhole says."""
    camera = read_cameras(config_folder() / "cameras.yaml")[name]
    in_camera = np.array([[0.0, 0.0, 2.0], [0.1, 0.0, 2.0], [0.0, 0.2, 2.0]])
    ahead = in_camera[:, :2] / in_camera[:, 2:] * camera.fx + (camera.cx, camera.cy)
    np.testing.assert_allclose(camera.to_pixels(turned(scene.camera_pose(camera), in_camera)), ahead, atol=1e-6)


@given(st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))
def test_the_body_is_between_its_axles_and_as_steep(pitch, x_m):
    half = 0.1 * np.array([np.cos(pitch), 0.0, np.sin(pitch)])
    middle = np.array([x_m, -0.1, 0.04])
    pose = scene.body_pose({"front_axle": middle + half, "rear_axle": middle - half})
    np.testing.assert_allclose(pose.at_m, [x_m, 0.0, 0.04], atol=1e-12)
    np.testing.assert_allclose(turned(pose, np.array([[0.1, 0.0, 0.0]]))[0] - pose.at_m, half, atol=1e-12)


@given(st.floats(-10.0, 10.0))
def test_a_leg_begins_at_its_hip_and_is_an_arc_of_its_radius(angle):
    arc = scene.leg(SANDBOT, "front_left", angle, 0.15)
    np.testing.assert_allclose(arc[0], [0.1, 0.075 + SANDBOT.leg_width_m, 0.0], atol=1e-12)
    centre = arc[0] - SANDBOT.leg_radius_m * np.array([np.sin(angle), 0.0, np.cos(angle)])
    np.testing.assert_allclose(np.linalg.norm(arc - centre, axis=1), SANDBOT.leg_radius_m, rtol=1e-9)


def test_a_leg_straight_down_reaches_two_radii_below_its_hip():
    low = {name: scene.leg(SANDBOT, name, 0.0, 0.15)[:, 2].min() for name in ("front_left", "rear_right")}
    assert low == pytest.approx(dict.fromkeys(low, -2 * SANDBOT.leg_radius_m), rel=1e-2)
    assert scene.leg(SANDBOT, "rear_right", 0.0, 0.15)[0, 0] == -0.1


def test_what_was_not_seen_is_not_drawn():
    assert groups(FLAT) == ["bed", "phi", "body", *SANDBOT.leg_order, *FLAT]
    assert groups(FLAT | {"front_axle": NAN}) == ["bed", "phi", "com", "rear_axle"]
    assert groups(FLAT, {"front_left": 0.0, "rear_left": np.nan}) == ["bed", "phi", "body", "front_left", *FLAT]


def test_the_bed_is_level_with_the_surface_and_says_when_it_blows():
    for blows in (False, True):
        ground, words = scene.bed(SANDBOT, 0.605, blows=blows)
        assert ground.pose.at_m[2] + ground.size_m[2] / 2 == pytest.approx(0.0)
        assert words.text == "φ 0.6050" + ", air on" * blows
        assert (ground.colour == scene.BLOWN) == blows
    assert scene.bed(SANDBOT, np.nan, blows=False)[1].text == "φ not known"


def test_shapes_replace_those_before_and_each_has_a_place_of_its_own():
    shapes = scene.scene(SANDBOT, FLAT, STANDING, 0.6, blows=False)
    clear, *drawn = marker_array(5, shapes).markers
    assert clear.action == clear.DELETEALL
    assert len({(one.ns, one.id) for one in drawn}) == len(shapes)
    assert {one.header.frame_id for one in drawn} == {topics.FRAME}
    kinds = {one.ns: one.type for one in drawn}
    assert (kinds["bed"], kinds["com"], kinds["front_left"], kinds["phi"]) == (
        clear.CUBE, clear.SPHERE, clear.LINE_STRIP, clear.TEXT_VIEW_FACING,
    )  # fmt: skip


@pytest.mark.ros
@pytest.mark.timeout(60)
def test_the_node_shows_what_it_hears(beside):
    process = subprocess.Popen([sys.executable, "-m", "sandbot_bringup.nodes.scene_node"])
    drawn, frames = [], {}
    endpoints.subscription(beside.node, topics.SCENE, lambda message: drawn.append({one.ns for one in message.markers}))
    endpoints.subscription(
        beside.node, topics.FRAMES, lambda one: frames.update({one.child_frame_id: one.transform.translation})
    )
    publishers = {name: endpoints.publisher(beside.node, topic) for name, topic in topics.LANDMARKS.items()}
    legs = endpoints.publisher(beside.node, topics.LEG_STATES)

    def tell():
        for name, at in FLAT.items():
            publishers[name].publish(messages.point(1, at))
        angles = np.zeros(6)
        legs.publish(messages.joint_state(1, topics.LEGS, angles, angles, angles))

    try:
        beside.until(lambda: drawn)
        assert "body" not in drawn[0]
        beside.until(lambda: tell() or {"body", "front_left", "com"} <= drawn[-1])
        beside.until(lambda: "base_link" in frames)
    finally:
        process.terminate()
        assert process.wait(30) == 0
    assert frames["base_link"].x == pytest.approx(0.3)
    assert frames["dorsal_optical_frame"].z == 2.12
