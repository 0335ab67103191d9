"""Rendered trials with known truth through the whole chain: frames to landmarks to speed to observables."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import camera_from_mapping
from sandbot_tracking.offline import LegClock, OfflineTracker
from sandbot_tracking.source import Source
from sandbot_tracking.tools import track_video
from sandbot_tracking.trial import summarise

R, H = 0.0355, 0.025
COMMON = {"width": 640, "height": 480, "fx": 1066.0, "fy": 1066.0, "cx": 319.5, "cy": 239.5}
DORSAL = {
    **COMMON,
    "position_m": [0.65, 0.0, 2.12],
    "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "plane": {"normal": "z", "offset_m": 0.12},
}
LATERAL = {
    **COMMON,
    "position_m": [0.58, -2.1, 0.1],
    "rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "plane": {"normal": "y", "offset_m": -0.1},
}


@pytest.fixture(scope="module")
def cameras():
    return {"dorsal": camera_from_mapping(DORSAL, "d"), "lateral": camera_from_mapping(LATERAL, "l")}


def walk(t, omega, s_over_r):
    """x and axle height of a robot whose stance is the arc x = R sin, from rest at t = 0."""
    t, alpha = np.asarray(t, dtype=float), np.arcsin(s_over_r / 2)
    step = np.floor(t * omega / np.pi)
    theta = np.clip((t * omega / np.pi - step) * np.pi - np.pi / 2, -alpha, alpha)
    x = step * s_over_r * R + R * (np.sin(theta) + np.sin(alpha))
    z = H + R * (np.cos(theta) - np.cos(alpha))
    return np.where(t < 0, 0.0, x), np.where(t < 0, H, z)


def film(scene, cameras, beds, rng, t, omega, s_over_r, x0=0.25):
    x, z = (float(value) for value in walk(t, omega, s_over_r))
    com = cameras["dorsal"].to_pixels([[x0 + x, 0.0, 0.12 + z - H]])
    axles = cameras["lateral"].to_pixels([[x0 + x + d, -0.1, z] for d in (-0.1, 0.1)])
    return scene.frame(rng, com, 7.0, beds[0]), scene.frame(rng, axles, 7.0, beds[1])


@pytest.mark.slow
def test_a_rendered_walk_gives_position_lift_peak_and_speed(scene, cameras, rng):
    omega, ratio = 16.0, 1.0
    beds = scene.grains(rng), scene.grains(rng)
    tracker = OfflineTracker(cameras)
    t = np.arange(-5, 160) / 100
    leg_t = np.arange(-10, 330) / 200
    angles = omega * np.maximum(leg_t, 0)[:, None] + np.array([-np.pi / 2] * 3 + [np.pi / 2] * 3)
    for when, angle in zip(leg_t, angles, strict=True):
        tracker.legs(float(when), angle)
    for when in t:
        tracker.update(float(when), *film(scene, cameras, beds, rng, when, omega, ratio))
    marks = tracker.landmarks()
    x, z = walk(t, omega, ratio)
    # 0.015 px are 0.03 mm; the parallax of the lift, 5 mm uncorrected, must be gone.
    assert np.sqrt(np.mean((marks.com[:, 0] - 0.25 - x) ** 2)) < 6e-5
    assert np.sqrt(np.mean((marks.front_axle[:, 2] - z) ** 2)) < 6e-5
    assert (marks.front_axle[:, 0] > marks.rear_axle[:, 0] + 0.19).all()
    summary = summarise(t, marks.com[:, 0], marks.front_axle[:, 2], marks.rear_axle[:, 2], leg_t, angles)
    assert summary.gaps == 0
    assert summary.reason == ""
    assert summary.speed_m_s == pytest.approx(omega * ratio * R / np.pi, rel=0.003)
    assert summary.peak_speed_m_s == pytest.approx(R * omega, rel=0.015)
    assert summary.lift_m == pytest.approx(R * (1 - np.cos(np.arcsin(ratio / 2))), abs=1e-4)
    assert summary.first_step_m == pytest.approx(ratio * R, abs=3e-4)


def test_a_covered_lateral_camera_makes_gaps_not_guesses(scene, cameras, rng):
    beds = scene.grains(rng), scene.grains(rng)
    tracker = OfflineTracker(cameras)
    for n in range(12):
        dorsal, lateral = film(scene, cameras, beds, rng, n / 100, 8.0, 0.9)
        if 5 <= n < 8:
            lateral = np.full_like(lateral, 30)
        sample = tracker.update(n / 100, dorsal, lateral)
        assert np.isnan(sample.com[0]) == np.isnan(sample.v_x) == (5 <= n < 8)
    assert tracker.counts["lateral"].missing == 6
    assert tracker.counts["lateral"].reacquired == 2


def test_leg_clock_reads_turning_and_standing_legs():
    clock = LegClock()
    for n in range(400):
        turned = 12.0 * np.clip(n / 200 - 0.5, 0, 1)
        clock.update(n / 200, np.full(6, (turned + np.pi) % (2 * np.pi)))
    assert clock.omega_rad_s(0.4) is None
    assert clock.omega_rad_s(1.4) == pytest.approx(12.0, rel=0.02)
    assert clock.omega_rad_s(1.9) is None


def test_a_tracker_without_dorsal_camera_is_refused(cameras):
    with pytest.raises(InputError, match="dorsal"):
        OfflineTracker({"lateral": cameras["lateral"]})


@pytest.mark.slow
def test_track_video_from_files_in_colour_and_in_grey(scene, cameras, rng, tmp_path, capsys):
    (tmp_path / "cameras.yaml").write_text(yaml.safe_dump({"dorsal": DORSAL, "lateral": LATERAL}))
    beds = scene.grains(rng), scene.grains(rng)
    writers = [
        cv2.VideoWriter(str(tmp_path / f"{name}.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 100.0, (640, 480), colour)
        for name, colour in (("dorsal", True), ("lateral", False))
    ]
    for n in range(-3, 60):
        above, beside = film(scene, cameras, beds, rng, n / 100, 24.0, 1.0)
        # Sand in warm light: less blue than red.
        writers[0].write(np.stack([(share * above).astype(np.uint8) for share in (0.7, 0.9, 1.0)], axis=-1))
        writers[1].write(beside)
    for writer in writers:
        writer.release()
    videos = [str(tmp_path / "dorsal.avi"), str(tmp_path / "lateral.avi")]
    options = ["--cameras", str(tmp_path / "cameras.yaml"), "--omega", "24", "--start", "0.03"]
    assert track_video.main([*videos, *options]) == 0
    assert "63 frames, 0 without" in capsys.readouterr().out
    table = np.genfromtxt(tmp_path / "dorsal.csv", delimiter=",", names=True)
    x = walk(np.arange(-3, 60) / 100, 24.0, 1.0)[0]
    assert np.sqrt(np.mean((table["com_x_m"] - 0.25 - x) ** 2)) < 1e-4


@pytest.mark.parametrize("content", [None, b"", b"not a video at all" * 50])
def test_unreadable_videos_are_one_line(tmp_path: Path, content):
    path = tmp_path / "broken.avi"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"broken\.avi") as caught:
        Source(str(path))
    assert "\n" not in str(caught.value)
