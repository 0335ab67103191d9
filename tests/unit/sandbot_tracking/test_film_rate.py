"""Frames are timed by the calibration, or by the film where that says nothing; where they disagree it is said."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
import yaml

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import camera_from_mapping
from sandbot_tracking.film_rate import FrameNumbers, film_rate
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


def stamped(path, scene, *, lost=(), knock_px=0.0):
    """The same, each frame with a time stamp of its own; without the ``lost`` frames; knocked after a third of them."""
    rng = np.random.default_rng(1)
    bed = scene.grains(rng, (240, 320))
    with av.open(str(path), "w") as film:
        stream = film.add_stream("ffv1", rate=50)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "gray"
        stream.codec_context.time_base = Fraction(1, 1000)
        for n in range(FRAMES):
            picture = scene.frame(rng, [(40.0 + STEP_PX * n, 120.0)], bed=bed)
            if n >= FRAMES // 3:
                picture = np.roll(picture, round(knock_px), axis=1)
            frame = av.VideoFrame.from_ndarray(picture, format="gray")
            frame.pts, frame.time_base = 20 * n, Fraction(1, 1000)
            film.mux(stream.encode(frame) if n not in lost else [])
        film.mux(stream.encode(None))
    return path


@pytest.mark.parametrize("rate", [{}, {"frame_rate_hz": FILM_HZ}], ids=["the film's", "calibrated"])
@pytest.mark.parametrize("lost", [(), range(20, 35)], ids=["whole", "cut"])
def test_frames_that_a_film_lacks_leave_a_gap_in_time(tmp_path, scene, lost, rate):
    """Times were counted by frame: as if the marker had jumped, 25 % too fast."""
    path = stamped(tmp_path / "film.mkv", scene, lost=lost)
    found = track(path, {"dorsal": camera(**rate)})
    numbers = [n for n in range(FRAMES) if n not in lost]
    assert found.t_s == pytest.approx(np.array(numbers) / FILM_HZ, rel=1e-3)
    mean = (found.com_m[-1, 0] - found.com_m[0, 0]) / (found.t_s[-1] - found.t_s[0])
    assert mean == pytest.approx(STEP_PX * METRES_A_PX * FILM_HZ, rel=0.01)
    assert found.timing.endswith("15 frames are missing in the film") is bool(lost)


def test_films_in_which_different_frames_are_missing_are_not_in_step(tmp_path, scene):
    whole, cut = (stamped(tmp_path / f"{lost}.mkv", scene, lost=lost) for lost in ((), (30,)))
    cameras = {"dorsal": camera(), "lateral": camera()}
    with pytest.raises(InputError, match=r"not in step from frame 30 on, by their own time stamps"):
        track(whole, cameras, lateral=cut)
    assert track(cut, cameras).t_s[30] == pytest.approx(31 / FILM_HZ)


@pytest.mark.parametrize(
    ("stamps_s", "numbers"),
    [
        ([], []),
        ([0.0], [0]),
        ([0.0, 0.0, 0.0], [0, 1, 2]),  # a container without stamps
        ([0.0, 0.04, 0.02, 0.06, 0.10], [0, 1, 2, 3, 4]),
        ([0.0, 0.033, 0.067, 0.1, 0.2, 0.233], [0, 1, 2, 3, 6, 7]),  # in whole milliseconds
        ([5.0, 5.03, 5.06, 5.1, 5.13], [0, 1, 2, 3, 4]),  # a telephone's, in uneven steps
    ],
)
def test_frames_are_numbered_by_their_stamps(stamps_s, numbers):
    film = FrameNumbers(30.0)
    assert [film.add(stamp_s) for stamp_s in stamps_s] == numbers
    assert film.missing == (numbers[-1] + 1 - len(numbers) if numbers else 0)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("rate_hz", [24, 29.97, 60, 200, 240, 400, 480, 1000])
def test_stamps_in_whole_milliseconds_hide_no_frame_and_show_what_is_missing(rate_hz, stated):
    """At 480 frames/s steps are of 2 and 3 ms; where they are shorter than that, only a gap is seen."""
    for lost in ((), (100, 300, 301) if rate_hz < 500 else tuple(range(100, 110))):
        film = FrameNumbers(stated * rate_hz)
        shown = [n for n in range(500) if n not in lost]
        numbers = [film.add(round(1e3 * (n + 0.3) / rate_hz) / 1e3) for n in shown]
        assert numbers == shown, lost


@pytest.mark.parametrize("knock_px", [0, 10])
def test_a_film_of_a_camera_that_was_knocked_gives_no_observables(tmp_path, scene, capsys, knock_px):
    path = stamped(tmp_path / "film.mkv", scene, knock_px=knock_px)
    (tmp_path / "cameras.yaml").write_text(yaml.safe_dump({"dorsal": DORSAL | {"frame_rate_hz": FILM_HZ}}))
    assert track_video.main([str(path), "--cameras", str(tmp_path / "cameras.yaml"), "--omega", "40"]) == 0
    printed = capsys.readouterr().out
    assert ("film.mkv: the camera has moved by 10.0 px during the film" in printed) is bool(knock_px)
    assert ("speed nan" in printed) is bool(knock_px)
