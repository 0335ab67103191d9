import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common import messages, topics

T = 1_700_000_000_123_456_789


def round_trip(message):
    from rclpy.serialization import deserialize_message, serialize_message

    return deserialize_message(serialize_message(message), type(message))


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_time_is_kept_to_the_nanosecond(t_ns):
    assert messages.nanoseconds(messages.stamp(t_ns)) == t_ns


def test_joint_state():
    values = np.arange(6.0)
    back = round_trip(messages.joint_state(T, topics.LEGS, values, values + 1, values + 2))
    assert tuple(back.name) == topics.LEGS
    np.testing.assert_array_equal([back.position, back.velocity, back.effort], [values, values + 1, values + 2])
    assert messages.nanoseconds(back.header.stamp) == T


def test_point_in_the_trackway_frame_with_nan_where_unseen():
    back = round_trip(messages.point(T, (0.1, math.nan, 0.025)))
    assert (back.header.frame_id, back.point.x, back.point.z) == ("trackway", 0.1, 0.025)
    assert math.isnan(back.point.y)


def test_twist_marks_what_is_not_measured():
    back = round_trip(messages.twist(T, 0.2, -0.1, 1e-4, 2e-4))
    assert (back.twist.twist.linear.x, back.twist.twist.linear.z) == (0.2, -0.1)
    assert np.diag(np.reshape(back.twist.covariance, (6, 6))).tolist() == [1e-4, -1, 2e-4, -1, -1, -1]


def test_bare_values_and_range():
    assert round_trip(messages.float64(0.6)).data == 0.6
    assert round_trip(messages.string("φ")).data == "φ"
    back = round_trip(messages.range_(T, 0.1, 0.05, 0.2, "bed"))
    np.testing.assert_allclose([back.range, back.min_range, back.max_range], [0.1, 0.05, 0.2], rtol=1e-6)


@given(st.integers(1, 20), st.integers(1, 20), st.integers(0, 2**32 - 1))
def test_image_pixels(height, width, seed):
    pixels = np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)
    back = round_trip(messages.image(T, "dorsal", pixels))
    assert (back.encoding, back.step) == ("mono8", width)
    np.testing.assert_array_equal(np.reshape(back.data, (height, width)), pixels)


def test_camera_info():
    matrix = np.array([[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]])
    info = round_trip(messages.camera_info(T, "dorsal", (640, 480), matrix, [0.1, 0.0, 0.0, 0.0, 0.2]))
    assert (info.width, info.height, info.header.frame_id) == (640, 480, "dorsal")
    np.testing.assert_array_equal(np.reshape(info.k, (3, 3)), matrix)
    np.testing.assert_array_equal(np.reshape(info.p, (3, 4)), np.column_stack([matrix, np.zeros(3)]))
    assert (info.distortion_model, list(info.d)) == ("plumb_bob", [0.1, 0.0, 0.0, 0.0, 0.2])


def test_diagnostics():
    status = round_trip(messages.diagnostics(T, "bed", {"stage": "pulse", "phi": 0.6}, level=1, text="late")).status[0]
    assert (status.level, status.name, status.message) == (b"\x01", "bed", "late")
    assert [(pair.key, pair.value) for pair in status.values] == [("stage", "pulse"), ("phi", "0.6")]
