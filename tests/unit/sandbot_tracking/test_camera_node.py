"""The camera node without a graph: what it says of a source that gives no more frames."""

import subprocess
import sys
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from sandbot_common import topics
from sandbot_common.ros import endpoints
from sandbot_tracking.nodes.camera_node import CameraNode


def camera(frames, *, is_device):
    one = object.__new__(CameraNode)
    one._source = SimpleNamespace(is_device=is_device, read=lambda: next(frames))
    one._health = SimpleNamespace(level=0, text="ok", settled=True)
    one._timer = SimpleNamespace(cancel=lambda: frames.close())
    one._frames, one._frame, one._info, one._stamp_ns = 1, "dorsal_optical_frame", None, lambda: 1
    one._image = SimpleNamespace(publish=lambda _: None)
    return one


def some(*frames):
    yield from frames


def test_a_device_that_gives_no_frames_is_an_error_until_it_gives_some():
    one = camera(some(None, np.zeros((2, 2), np.uint8)), is_device=True)
    one._next()
    assert (one._health.level, one._health.text) == (2, "the device gives no frames")
    one._next()
    assert (one._health.level, one._health.text, one._frames) == (0, "ok", 2)


def test_a_film_that_ends_is_none():
    frames = some(None)
    one = camera(frames, is_device=False)
    one._next()
    assert (one._health.level, one._health.text, next(frames, "cancelled")) == (0, "the video has ended", "cancelled")


@pytest.fixture
def start(tmp_path, domain):
    """Start a camera node of that name with a film; all end with the test."""
    film, started = tmp_path / "film.avi", []
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (64, 48))
    for level in range(50):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    run = "from sandbot_tracking.nodes.camera_node import main; import sys; sys.exit(main())"

    def begin(name, view):
        given = ["-r", f"__node:={name}", "-p", f"camera:={view}", "-p", f"video:={film}"]
        command = [sys.executable, "-c", run, "--ros-args", *given]
        started.append(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.ros
def test_a_second_camera_of_a_name_ends_before_it_shows_anything(start, beside):
    frames, told = [], []
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, told.append)
    first = start("dorsal_camera", "dorsal")
    beside.until(lambda: told)
    endpoints.subscription(beside.node, topics.DORSAL_IMAGE, frames.append)
    second = start("dorsal_camera", "dorsal")
    _, said = second.communicate(timeout=60)
    assert second.returncode == 2
    assert said.endswith("another dorsal_camera is running already; one commander at a time, end it first\n")
    beside.until(lambda: len(frames) == 50)
    beside.wait(lambda: len(frames) > 50, 1.0)
    assert len(frames) == 50
    assert first.poll() is None


@pytest.mark.ros
def test_two_cameras_of_the_usual_name_may_be_those_of_both_views(start, beside):
    shown = {view: [] for view in topics.VIEWS}
    for view, topic in topics.VIEWS.items():
        endpoints.subscription(beside.node, topic.image, shown[view].append)
        start("camera", view)
    beside.until(lambda: all(shown.values()))
