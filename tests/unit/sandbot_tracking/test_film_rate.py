"""Frames are timed by the calibration, or by the film where that says nothing; where they disagree it is said."""

import cv2
import numpy as np
import pytest
import yaml

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import camera_from_mapping
from sandbot_tracking.film_rate import film_rate
from sandbot_tracking.tools import track_video
from sandbot_tracking.videos import track

DORSAL = {
    "width": 320, "height": 240, "fx": 500.0, "fy": 500.0, "cx": 159.5, "cy": 119.5,
    "position_m": [0.0, 0.0, 1.1],
    "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "plane": {"normal": "z", "offset_m": 0.1},
}  # fmt: skip
FILM_HZ, FRAMES, STEP_PX = 50.0, 60, 3.0
METRES_A_PX = 1.0 / 500.0


def camera(**more):
    return camera_from_mapping({**DORSAL, **more}, "dorsal")


@pytest.fixture(scope="module")
def film(tmp_path_factory, scene):
    """A marker that walks 3 px a frame, in a file that says 50 frames a second."""
    path, rng = tmp_path_factory.mktemp("film") / "top.avi", np.random.default_rng(1)
    bed = scene.grains(rng, (240, 320))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), FILM_HZ, (320, 240), False)
    for n in range(FRAMES):
        writer.write(scene.frame(rng, [(40.0 + STEP_PX * n, 120.0)], bed=bed))
    writer.release()
    return path


@pytest.mark.parametrize(
    ("given", "rate_hz", "said"),
    [
        pytest.param(
            {}, FILM_HZ, "timed at 50 frames/s as {} says, for the calibration gives no rate", id="the film's"
        ),
        pytest.param(
            {"frame_rate_hz": 500.0}, 500.0, "timed at 500 frames/s as calibrated, but {} says 50", id="calibrated"
        ),
        pytest.param({"frame_rate_hz": 100.0}, 100.0, "as calibrated, but {} says 50", id="the default, but given"),
        pytest.param({"frame_rate_hz": 50.4}, 50.4, "", id="agreed"),
    ],
)
def test_a_film_is_timed_by_its_calibration_or_by_itself(film, tmp_path, capsys, given, rate_hz, said):
    (tmp_path / "cameras.yaml").write_text(yaml.safe_dump({"dorsal": {**DORSAL, **given}}))
    found = track(film, tmp_path / "cameras.yaml")
    assert found.t_s[-1] == pytest.approx((FRAMES - 1) / rate_hz)
    assert np.median(found.v_x_m_s) == pytest.approx(STEP_PX * METRES_A_PX * rate_hz, rel=0.01)
    assert said.format(film) in found.timing
    assert bool(said) == bool(found.timing)
    options = ["--cameras", str(tmp_path / "cameras.yaml"), "--out", str(tmp_path / "top.csv")]
    assert track_video.main([str(film), *options]) == 0
    printed = capsys.readouterr().out
    assert printed.endswith(f"start at 0.000 s{'; ' if said else ''}{found.timing}\n")


def test_cameras_read_without_a_rate_know_that_they_have_none(film):
    found = track(film, {"dorsal": camera()})
    assert found.t_s[-1] == pytest.approx((FRAMES - 1) / FILM_HZ)
    with pytest.raises(InputError, match="unknown key 'rate_is_known'"):
        camera(rate_is_known=True)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"omega_rad_s": "12"}, "omega_rad_s: '12'; a number or None is needed"),
        ({"start_s": "0"}, "start_s: '0'; a number or None is needed"),
        ({"robot": None}, "robot: None; a string, Path or Robot is needed"),
        ({"calibration": {"dorsal": DORSAL}}, "a string, Path or a mapping to Camera is needed"),
        ({"omega_rad_s": 12, "start_s": np.float64(0)}, "nowhere.avi: no such video file"),
    ],
)
def test_an_argument_of_another_type_is_named(given, said):
    with pytest.raises(InputError, match=said):
        track(**{"video": "nowhere.avi", "calibration": {"dorsal": camera()}, **given})


def test_two_films_in_step_have_one_rate():
    known, unknown = camera(frame_rate_hz=100.0), camera()
    films = {"top.avi": 30.0, "side.avi": 29.97}
    assert film_rate({"dorsal": known, "lateral": unknown}, {"top.avi": 100.0, "side.avi": 99.5}) == (100.0, "")
    assert film_rate({"dorsal": unknown, "lateral": known}, films)[0] == 100.0
    rate_hz, said = film_rate({"dorsal": unknown, "lateral": unknown}, films)
    assert (rate_hz, "side.avi" in said) == (30.0, False)
    assert film_rate({"dorsal": unknown}, {**films, "side.avi": 60.0})[1].endswith(", but side.avi says 60")


@pytest.mark.parametrize("nothing", [0.0, float("nan"), -1.0, 90000.0])
def test_a_film_that_knows_no_rate_needs_one_given(nothing):
    with pytest.raises(InputError, match=r"top.avi: says no frame rate: give frame_rate_hz in cameras.yaml"):
        film_rate({"dorsal": camera()}, {"top.avi": nothing})
    assert film_rate({"dorsal": camera(frame_rate_hz=200.0)}, {"top.avi": nothing}) == (200.0, "")
