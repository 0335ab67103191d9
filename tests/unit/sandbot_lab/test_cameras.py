"""Frames: discs where the geometry puts them, blurred by the exposure, in noise of the stated size."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from rig import QUIET, trial

import sandbot_lab
from sandbot_common.errors import InputError
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.calibration import calibration
from sandbot_lab.cameras import BODY_GREY, CONTRAST, LabCamera

FILE = Path(sandbot_lab.__file__).resolve().parents[2] / "sandbot_bringup" / "config" / "cameras.yaml"
CAMERAS = read_yaml(FILE)


def centroid(frame, u, v, reach=11):
    """Centre of what is bright within reach of (u, v) [px]."""
    rows, columns = np.mgrid[round(v) - reach : round(v) + reach + 1, round(u) - reach : round(u) + reach + 1]
    weight = np.clip(frame[rows, columns].astype(float) - 125.0, 0.0, None)
    return (weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()


def truth_px(camera, x, z):
    one = np.array([x]), np.array([z]), np.zeros(1)
    return [camera.calibration.pixels(marker)[0] for marker in camera.markers(*one)]


@pytest.mark.parametrize("name", ["dorsal", "lateral"])
def test_discs_lie_at_their_sub_pixel_places(name):
    camera, errors = LabCamera(name, CAMERAS[name], seed=3), []
    for x in np.linspace(0.15, 1.0, 25):
        frame = camera.render(x, 0.0291)
        for place in truth_px(camera, x, 0.0291):
            errors.append(np.subtract(centroid(frame, *place), place))
    assert np.sqrt(np.mean(np.square(errors))) < 0.06
    assert np.abs(np.mean(errors, axis=0)).max() < 0.03


def test_the_projection_is_opencvs():
    section = {**CAMERAS["dorsal"], "distortion": [-0.2, 0.05, 0.001, -0.002, 0.01]}
    camera = calibration(section, "dorsal")
    points = np.random.default_rng(0).uniform([0.1, -0.3, 0.0], [1.1, 0.3, 0.2], (50, 3))
    rotation = np.array(section["rotation"])
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    wanted, _ = cv2.projectPoints(
        points, cv2.Rodrigues(rotation)[0], -rotation @ camera.position_m, matrix, np.array(camera.distortion)
    )
    assert camera.pixels(points) == pytest.approx(wanted[:, 0], abs=1e-6)


def test_all_markers_are_in_view_at_the_start():
    for name in ("dorsal", "lateral"):
        camera = LabCamera(name, CAMERAS[name], seed=0)
        for u, v in truth_px(camera, 0.15, 0.025) + truth_px(camera, 1.0, 0.036):
            assert 12 < u < 628
            assert 12 < v < 468


def test_the_dorsal_marker_rises_with_the_body():
    camera = LabCamera("dorsal", CAMERAS["dorsal"], seed=0)
    ((low, _),), ((high, _),) = truth_px(camera, 1.0, 0.025), truth_px(camera, 1.0, 0.036)
    assert high - low == pytest.approx(1066 * 0.42 * (1 / 1.989 - 1 / 2.0), rel=1e-6)


def test_motion_blurs_over_the_exposure():
    camera = LabCamera("dorsal", CAMERAS["dorsal"], seed=0)
    still = camera.render(0.5, 0.025)
    moving = camera.render(0.5 + np.linspace(-0.01, 0.01, 9), 0.025)
    ((u, v),) = truth_px(camera, 0.5, 0.025)
    across = slice(round(u) - 14, round(u) + 15)
    # The rim takes as many more pixels as the disc moved.
    rim = [np.count_nonzero(np.abs(frame[round(v), across].astype(float) - 130.0) < 65) for frame in (still, moving)]
    assert rim[1] - rim[0] >= 8
    assert centroid(moving, u, v, reach=14)[0] == pytest.approx(u, abs=0.15)


def test_film_agrees_with_render_and_stands_before_the_start():
    trace = trial(QUIET, 0.62, 12.0)
    first, second = (LabCamera("lateral", CAMERAS["lateral"], seed=1) for _ in range(2))
    legs = trace.leg_angle_rad[0]
    assert np.array_equal(first.film(trace, -0.5), second.render(trace.x_m[0], trace.z_m[0], legs_rad=legs))
    assert first.film(trace, 1.0).dtype == np.uint8
    assert first.film(trace, 1.0).shape == (480, 640)


def test_the_led_flashes_in_its_region_only():
    dark, lit = (LabCamera("dorsal", CAMERAS["dorsal"], seed=2).render(0.5, 0.025, led_on=on) for on in (False, True))
    x, y, width, height = CAMERAS["dorsal"]["led_region"]
    changed = np.argwhere(dark != lit)
    assert lit[y : y + height, x : x + width].max() > 230
    assert changed[:, 0].min() >= y
    assert changed[:, 0].max() < y + height
    assert changed[:, 1].min() >= x
    assert changed[:, 1].max() < x + width


def test_noise_differs_from_frame_to_frame_and_the_ground_does_not():
    camera = LabCamera("dorsal", CAMERAS["dorsal"], seed=4)
    frames = np.array([camera.render(0.5, 0.025) for _ in range(40)], dtype=float)
    ((u, v),) = truth_px(camera, 0.5, 0.025)
    ground = frames[:, 300:, 100:300]
    assert ground.std(axis=0, ddof=1).mean() == pytest.approx(6.0, rel=0.05)
    assert ground.mean(axis=0).std() == pytest.approx(10.0, rel=0.15)
    disc = frames[:, round(v) - 2 : round(v) + 3, round(u) - 2 : round(u) + 3]
    assert disc.mean() == pytest.approx(BODY_GREY + CONTRAST, abs=1.5)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("side", {}, "'side' is not dorsal or lateral"),
        ("dorsal", {"fx": float("nan")}, "fx: nan"),
        ("dorsal", {"focus": 1}, "unknown key 'focus'"),
        ("dorsal", {"rotation": [[1, 0, 0], [0, 1, 0], [0, 1, 1]]}, "not 3 orthonormal rows"),
        ("dorsal", {"rotation": ["a"]}, "not 3 orthonormal rows"),
        ("dorsal", {"position_m": [0.0, 1.0]}, "position_m: [0.0, 1.0] has 2 numbers, expected 3"),
        ("dorsal", {"plane": {"normal": "w", "offset_m": 0.1}}, "plane"),
        ("dorsal", {"plane": {"normal": "z"}}, "plane"),
    ],
)
def test_bad_calibrations_are_refused(name, change, words):
    with pytest.raises(InputError) as refusal:
        LabCamera(name, {**CAMERAS["dorsal"], **change}, seed=0)
    assert words in str(refusal.value)


@pytest.mark.parametrize("name", ["dorsal", "lateral"])
@pytest.mark.parametrize(("x", "z"), [(-1.0, 0.03), (1.6, 0.03), (3.0, 0.03), (0.5, 3.0), (0.5, -3.0)])
def test_a_robot_out_of_the_picture_leaves_the_ground(name, x, z):
    """One with long legs may walk out of view before its trial ends."""
    frame = LabCamera(name, CAMERAS[name], seed=3).render(x, z)
    if name == "lateral" or abs(z) < 1.0:
        assert frame.max() < 200
    assert frame.shape == (480, 640)
    assert LabCamera(name, CAMERAS[name], seed=3).render(0.5, 0.03).max() > 200


def filmed(name, body=True):
    """A camera, and its frames of a walk at 100 a second."""
    camera, trace = LabCamera(name, CAMERAS[name], seed=1, body=body), trial(QUIET, 0.62, 12.0)
    return camera, trace, [camera.film(trace, k / 100) for k in range(120)]


@pytest.mark.parametrize("name", ["dorsal", "lateral"])
def test_what_surrounds_a_marker_is_what_it_was_without_legs_surface_and_prints(name):
    """Same seed, same noise: within 9 px of a marker each pixel is that of a frame without any scenery."""
    camera, trace, frames = filmed(name)
    plain = LabCamera(name, CAMERAS[name], seed=1)
    plain._scenery = None
    plain._ground = LabCamera(name, CAMERAS[name], seed=1, body=False)._ground
    differs = 0
    for k, frame in enumerate(frames):
        bare = plain.film(trace, k / 100)
        x, z = (np.interp(k / 100, trace.t_s, values) for values in (trace.x_m, trace.z_m))
        for u, v in truth_px(camera, x, z):
            near = (slice(round(v) - 9, round(v) + 10), slice(round(u) - 9, round(u) + 10))
            rows, columns = np.mgrid[near]
            close = np.hypot(rows - v, columns - u) < 9.0
            assert np.array_equal(frame[near][close], bare[near][close])
        differs += not np.array_equal(frame, bare)
    assert differs == len(frames)  # control: there is scenery


@pytest.mark.parametrize("name", ["dorsal", "lateral"])
def test_scenery_is_dimmer_than_a_marker_and_prints_stay_where_a_foot_was(name):
    _, _, frames = filmed(name)
    assert sum(int((frame > 160).sum()) for frame in frames[:1]) < 3 * 130  # the discs, and nothing else
    _, _, bare = filmed(name, body=False)
    assert darkened(frames) > 30
    assert darkened(bare) < 10  # control: noise alone


def darkened(frames):
    """Pixels of grains that are dark at the end and were not at the beginning."""
    first, last = (np.mean(frames[k : k + 4], axis=0) for k in (0, 116))
    return int(((last < 34) & (first > 52)).sum())
