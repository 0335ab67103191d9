"""The camera node without a graph: what it says of a source that gives no more frames."""

from types import SimpleNamespace

import numpy as np

from sandbot_tracking.nodes.camera_node import CameraNode


def camera(frames, *, is_device):
    one = object.__new__(CameraNode)
    one._source = SimpleNamespace(is_device=is_device, read=lambda: next(frames))
    one._health, one._timer = SimpleNamespace(level=0, text="ok"), SimpleNamespace(cancel=lambda: frames.close())
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
