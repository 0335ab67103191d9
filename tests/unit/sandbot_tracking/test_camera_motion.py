"""A camera that is knocked is told from one that stands still, whatever moves in its picture."""

import cv2
import numpy as np
import pytest

from sandbot_tracking.camera_motion import CameraMotion

SHAPE, FRAMES, KNOCK = (480, 640), 100, 60


def film(shift=lambda number: (0.0, 0.0), texture=12.0, wall=0, seed=0):
    """Grains behind a dark body that crosses the picture, with footprints behind it, as a noisy camera sees them.

    ``wall``: how many columns at the left show a wall without texture.
    """
    rng = np.random.default_rng(seed)
    grains = 80 + texture * rng.standard_normal(SHAPE)
    grains[:, :wall] = 80
    for number in range(FRAMES):
        x = 20 + 4 * number
        grains[200:240:16, x - 20 : x] = 40
        scene = grains.copy()
        scene[180:260, x : x + 160] = 30 + 5 * np.sin(np.arange(160) / 4)
        move = np.float32([[1, 0, shift(number)[0]], [0, 1, shift(number)[1]]])
        seen = cv2.warpAffine(scene, move, SHAPE[::-1], borderMode=cv2.BORDER_REPLICATE)
        yield np.clip(seen + 4 * rng.standard_normal(SHAPE), 0, 255).astype(np.uint8)


def moved_px(frames):
    camera = CameraMotion(20.0)
    for frame in frames:
        camera.see(frame)
    return camera.moved_px


@pytest.mark.parametrize("by", [(10.0, 0.0), (0.0, -3.0), (-1.5, 1.5), (50.0, 0.0)])
def test_a_knock_in_the_middle_is_measured(by):
    assert moved_px(film(lambda number: by if number >= KNOCK else (0.0, 0.0))) == pytest.approx(np.hypot(*by), abs=0.3)


@pytest.mark.parametrize(
    "frames",
    [
        film(),
        film(lambda number: (0.4, 0.0) if number >= KNOCK else (0.0, 0.0)),  # settles a little
        film(lambda number: (8.0, 0.0) if KNOCK <= number < KNOCK + 4 else (0.0, 0.0)),  # shakes, and is back
        film(texture=0.0),  # nothing is known: the body alone moves
        film(wall=560),
    ],
    ids=["still", "settles", "shaken", "no texture", "hardly any texture"],
)
def test_a_camera_that_stays_has_not_moved(frames):
    assert moved_px(frames) == 0.0


def test_a_third_of_the_picture_without_texture_hides_no_knock():
    assert moved_px(film(lambda number: (10.0 * (number >= KNOCK), 0.0), wall=220)) == pytest.approx(10.0, abs=0.3)


@pytest.mark.parametrize("change", ["light", "hand", "other grains"])
def test_what_changes_the_picture_without_shifting_it_is_no_move(change):
    other = list(film(seed=1))

    def changed(number, frame):
        if number < KNOCK:
            return frame
        if change == "light":
            return np.clip(1.6 * frame, 0, 255).astype(np.uint8)
        if change == "hand":
            return np.where(np.arange(SHAPE[1]) < 500, 200, frame).astype(np.uint8)
        return other[number]

    assert moved_px(changed(number, frame) for number, frame in enumerate(film())) == 0.0


def test_a_picture_of_a_few_pixels_is_no_error():
    for shape in ((1, 1), (2, 3), (9, 7)):
        assert moved_px(np.full(shape, level, np.uint8) for level in range(50)) == 0.0
