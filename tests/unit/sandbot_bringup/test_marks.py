import cv2
import numpy as np
import pytest

from sandbot_bringup.marks import COLOURS, PATIENCE_NS, SEEN_BY, MarkedView
from sandbot_bringup.node_table import table_path
from sandbot_tracking.calibration import read_cameras

CAMERAS = read_cameras(table_path().with_name("cameras.yaml"))
GREY = np.full((480, 640), 90, np.uint8)
NAN = (float("nan"),) * 3
STEP_NS = 10_000_000


def view(camera):
    return MarkedView(CAMERAS[camera], SEEN_BY[camera])


def seen_at(drawn, name):
    """The centre [px] of what is drawn in the colour of a mark."""
    pixels = cv2.imdecode(np.frombuffer(drawn.jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
    ring = np.abs(pixels - COLOURS[name]).sum(axis=2) < 120
    rows, columns = np.nonzero(ring)
    return (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2


@pytest.mark.parametrize(("camera", "name"), [(camera, name) for camera, names in SEEN_BY.items() for name in names])
def test_a_mark_is_drawn_where_the_camera_sees_it(camera, name):
    one = view(camera)
    xyz = CAMERAS[camera].to_plane([[300.0, 200.0]])[0]
    assert one.picture(0, GREY) is None  # it waits for its landmarks
    drawn = [one.landmark(other, 0, xyz if other == name else NAN) for other in SEEN_BY[camera]][-1]
    assert drawn.seen == (name,)
    assert seen_at(drawn, name) == pytest.approx((300.0, 200.0), abs=1.5)


def test_landmarks_that_came_first_are_drawn_and_those_of_another_frame_are_not():
    one = view("dorsal")
    xyz = CAMERAS["dorsal"].to_plane([[300.0, 200.0]])[0]
    one.landmark("com", 0, xyz)
    assert one.picture(0, GREY).seen == ("com",)
    assert one.picture(STEP_NS, GREY) is None


def test_a_tracker_that_is_behind_is_waited_for_and_one_that_is_gone_is_not():
    one = view("dorsal")
    xyz = CAMERAS["dorsal"].to_plane([[300.0, 200.0]])[0]
    assert one.picture(0, GREY) is None
    assert one.picture(20 * STEP_NS, GREY) is None
    assert one.landmark("com", 0, xyz).seen == ("com",)
    assert one.picture(40 * STEP_NS, GREY) is None
    late = one.picture(40 * STEP_NS + PATIENCE_NS, GREY)
    assert late is not None
    assert late.seen == ()


def test_a_mark_that_was_not_seen_is_not_drawn():
    one = view("dorsal")
    one.picture(0, GREY)
    drawn = one.landmark("com", 0, NAN)
    assert drawn.seen == ()
    plain = cv2.imdecode(np.frombuffer(drawn.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(plain.astype(int) - 90).max() < 5
