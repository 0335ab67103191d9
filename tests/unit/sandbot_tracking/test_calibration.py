"""Pixels to metres and back, lens distortion and refusals."""

import re

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pictures import Lens, traced

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import camera_from_mapping, cameras_from_mapping, checksum, read_cameras
from sandbot_tracking.lens import Board, entry, lens_from_board
from sandbot_tracking.tools import calibrate

DORSAL = {
    "width": 640, "height": 480, "fx": 1066.0, "fy": 1050.0, "cx": 319.5, "cy": 239.5,
    "distortion": [-0.2, 0.05, 0.001, -0.0005, 0.0],
    "position_m": [0.65, 0.0, 2.12],
    "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "plane": {"normal": "z", "offset_m": 0.12},
}  # fmt: skip


@given(st.floats(5, 635), st.floats(5, 475), st.floats(-0.1, 0.3))
def test_to_plane_and_to_pixels_undo_each_other(u, v, height):
    camera = camera_from_mapping(DORSAL, "dorsal")
    xyz = camera.to_plane([[u, v]], height)
    assert xyz[0, 2] == pytest.approx(height, abs=1e-12)
    np.testing.assert_allclose(camera.to_pixels(xyz), [[u, v]], atol=1e-5)


@pytest.mark.parametrize("key", [key for key in DORSAL if key not in ("rotation", "plane", "distortion", "position_m")])
def test_a_checksum_tells_any_two_calibrations_apart(key):
    both = {"dorsal": DORSAL, "lateral": DORSAL}
    own = checksum(cameras_from_mapping(both, "cameras"))
    laid_out_otherwise = {"lateral": dict(reversed(DORSAL.items())), "dorsal": DORSAL}
    assert checksum(cameras_from_mapping(laid_out_otherwise, "cameras")) == own
    changed = {**both, "lateral": {**DORSAL, key: DORSAL[key] + 1}}
    assert checksum(cameras_from_mapping(changed, "cameras")) != own


def test_missing_markers_stay_missing():
    camera = camera_from_mapping({**DORSAL, "distortion": [0.0] * 5}, "dorsal")
    assert np.isnan(camera.to_plane([[np.nan, np.nan]])).any()


def test_covariance_is_what_noisy_pixels_scatter(rng):
    camera = camera_from_mapping(DORSAL, "dorsal")
    px = np.array([[500.0, 100.0]])
    scatter = camera.to_plane(px + rng.normal(0, [0.5, 0.2], (20000, 2)))[:, :2]
    claimed = camera.covariance_m2(px, [[0.25, 0.04]])[0, :2, :2]
    np.testing.assert_allclose(np.sqrt(np.diag(claimed)), scatter.std(axis=0), rtol=0.03)


def test_parallax_is_the_derivative_by_plane_height():
    camera = camera_from_mapping(DORSAL, "dorsal")
    px = [[600.0, 300.0]]
    moved = (camera.to_plane(px, 0.121) - camera.to_plane(px, 0.119)) / 0.002
    np.testing.assert_allclose(camera.parallax(px), moved, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": float("nan")}, "fx"),
        ({"focal": 3.0}, "focal"),
        ({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "not a rotation"),
        ({"rotation": [[1, 0], [0, 1]]}, "3 rows"),
        ({"plane": {"normal": "w", "offset_m": 0.0}}, "normal"),
        ({"position_m": [1.0, 2.0]}, "position_m"),
        ({"width": 0}, "width"),
        (
            {"frame_rate_hz": 100.0, "exposure_s": 0.02},
            "exposure_s: 0.02 s is longer than a frame, 0.01 s at frame_rate_hz: 100",
        ),
        ({"exposure_s": 2.0}, "exposure_s: 2.0 is outside"),
        ({"fx": 10.66}, "fx: 10.66 px for 640 px is a field of view of 176 degrees"),
        ({"led_region": [2400, 8, 24, 24]}, r"led_region: .* is not inside the picture, 640 x 480 px"),
        ({"position_m": [580.0, 0.0, 2120.0]}, "position_m: 580"),
    ],
)
def test_bad_cameras_are_refused_by_name(change, message):
    with pytest.raises(InputError, match=message) as caught:
        camera_from_mapping({**DORSAL, **change}, "cameras.yaml: dorsal")
    assert str(caught.value).startswith("cameras.yaml: dorsal")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "change",
    [
        {"frame_rate_hz": 100.0, "exposure_s": 0.01},
        {"exposure_s": 0.03},  # of a film, whose own rate counts
        {"fx": 100.0, "fy": 100.0},
        {"led_region": [616, 456, 24, 24]},
    ],
)
def test_what_a_camera_can_have_is_accepted(change):
    camera_from_mapping({**DORSAL, **change}, "dorsal")


def test_a_camera_of_an_unknown_name_is_refused(tmp_path):
    for names, known in ((("dorsal", "lateral"), True), (("dorsal", "top"), False)):
        (tmp_path / "c.yaml").write_text(yaml.safe_dump(dict.fromkeys(names, DORSAL)))
        if known:
            assert set(read_cameras(tmp_path / "c.yaml")) == set(names)
            continue
        with pytest.raises(InputError, match=r"c.yaml: no camera is called 'top'; known: dorsal, lateral"):
            read_cameras(tmp_path / "c.yaml")


def test_calibrate_finds_the_camera_again(tmp_path, rng, capsys):
    camera = camera_from_mapping({**DORSAL, "fy": 1066.0, "distortion": [0.0] * 5}, "dorsal")
    points = np.column_stack((rng.uniform(0.4, 0.9, 40), rng.uniform(-0.15, 0.15, 40), rng.uniform(0, 0.4, 40)))
    pixels = camera.to_pixels(points) + rng.normal(0, 0.05, (40, 2))
    table = tmp_path / "points.csv"
    np.savetxt(table, np.column_stack((pixels, points)), delimiter=",", header=",".join(calibrate.COLUMNS), comments="")
    out = tmp_path / "cameras.yaml"
    assert calibrate.main([str(table), "--name", "dorsal", "--plane", "0.12", "--out", str(out)]) == 0
    found = read_cameras(out)["dorsal"]
    np.testing.assert_allclose(found.to_plane([[100.0, 100.0]]), camera.to_plane([[100.0, 100.0]]), atol=3e-4)
    assert "reprojection error 0.0" in capsys.readouterr().out
    assert yaml.safe_load(out.read_text())["dorsal"]["width"] == 640


def table_of(camera, rng, path):
    """A table of points as the camera sees them, and the words that calibrate it as the dorsal one."""
    points = np.column_stack((rng.uniform(0.4, 0.9, 40), rng.uniform(-0.15, 0.15, 40), rng.uniform(0, 0.4, 40)))
    table = np.column_stack((camera.to_pixels(points), points))
    np.savetxt(path / "p.csv", table, delimiter=",", header=",".join(calibrate.COLUMNS), comments="")
    return [str(path / "p.csv"), "--name", "dorsal", "--plane", "0.12", "--out", str(path / "c.yaml")]


def other_pixels(table):
    table[3, :2] = table[7, :2]
    return table


def shuffled(table):
    table[:, :2] = np.roll(table[:, :2], 1, axis=0)
    return table


@pytest.mark.parametrize(
    ("change", "said"),
    [
        pytest.param(other_pixels, r"px rms, 1\.9 at most, but 0\.\d without row 5: correct it", id="a row's pixels"),
        pytest.param(shuffled, "at most; are columns exchanged, rows mixed up", id="rows"),
        pytest.param(lambda table: table * (1, 1, 1000, 1000, 1000), "row 2: x_m: .* m; divide mm by 1000", id="mm"),
        pytest.param(lambda table: table[:, [0, 1, 4, 2, 3]], "does not look at the plane z = 0.12 m", id="axes"),
        pytest.param(lambda table: table[:, [1, 0, 2, 3, 4]], "at most; are columns exchanged", id="u and v"),
        pytest.param(
            lambda table: table / (640, 640, 1, 1, 1), "do not determine where the camera stands", id="shares"
        ),
    ],
)
def test_points_that_no_camera_sees_make_no_calibration(tmp_path, rng, capsys, change, said):
    """Control: as they are, they do."""
    words = table_of(camera_from_mapping({**DORSAL, "distortion": [0.0] * 5}, "dorsal"), rng, tmp_path)
    table = np.loadtxt(words[0], delimiter=",", skiprows=1)
    assert calibrate.main(words) == 0
    (tmp_path / "c.yaml").unlink()
    np.savetxt(words[0], change(table), delimiter=",", header=",".join(calibrate.COLUMNS), comments="")
    capsys.readouterr()
    assert calibrate.main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"error: {words[0]}: " in line
    assert re.search(said, line)
    assert not (tmp_path / "c.yaml").exists()


def test_points_are_numbers_as_people_write_them(tmp_path):
    row, table = "1,2,\N{MINUS SIGN}0.1,0.2,0.3\n", tmp_path / "p.csv"
    table.write_text(",".join(calibrate.COLUMNS) + "\n" + row * calibrate.LEAST_POINTS, encoding="utf-8")
    assert calibrate.read_table(table).points_m[0].tolist() == [-0.1, 0.2, 0.3]
    table.write_text(
        ",".join(calibrate.COLUMNS) + "\n" + row * calibrate.LEAST_POINTS + "1_0,2,0.1,0.2,0.3\n", encoding="utf-8"
    )
    with pytest.raises(InputError, match="'1_0' is not a number"):
        calibrate.read_table(table)


def test_calibrate_writes_the_frame_rate_it_is_told(tmp_path, rng, capsys):
    words = table_of(camera_from_mapping(DORSAL, "dorsal"), rng, tmp_path)
    assert calibrate.main(words) == 0
    assert not read_cameras(tmp_path / "c.yaml")["dorsal"].rate_is_known
    assert calibrate.main([*words, "--rate", "250"]) == 0
    # It stays when the camera is calibrated again, and gives way to another.
    assert calibrate.main(words) == 0
    assert read_cameras(tmp_path / "c.yaml")["dorsal"].frame_rate_hz == 250.0
    assert calibrate.main([*words, "--rate", "120"]) == 0
    assert read_cameras(tmp_path / "c.yaml")["dorsal"].frame_rate_hz == 120.0
    for bad in ("0", "nan", "20000"):
        assert calibrate.main([*words, "--rate", bad]) == 2
        assert f"--rate {float(bad)}: 0.1 to 10000 frames/s" in capsys.readouterr().err


BIG = {**DORSAL, "width": 1280, "height": 960, "fx": 2000.0, "fy": 2000.0, "cx": 639.5, "cy": 479.5,
       "distortion": [0.0] * 5}  # fmt: skip


def photos(folder, rng):
    """Pictures of a chessboard as the BIG camera takes them."""
    folder.mkdir()
    texture, camera = chessboard(), camera_from_mapping(BIG, "dorsal")
    middle = np.array([texture.shape[1], texture.shape[0], 0.0]) / TEXTURE / 2
    for number in range(6):
        turn = cv2.Rodrigues(rng.uniform(-0.4, 0.4, 3))[0]
        place = np.array([*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.8, 0.9)]) - turn @ middle
        plane = camera.matrix @ np.column_stack((turn[:, 0], turn[:, 1], place))
        picture = cv2.warpPerspective(texture, plane @ np.diag((1 / TEXTURE, 1 / TEXTURE, 1)), (1280, 960))
        cv2.imwrite(str(folder / f"{number}.png"), cv2.GaussianBlur(picture, (0, 0), 1.0))


def test_the_pictures_of_the_board_say_the_size(tmp_path, rng, capsys):
    photos(tmp_path / "board", rng)
    words = table_of(camera_from_mapping(BIG, "dorsal"), rng, tmp_path)
    words += ["--chessboard", str(tmp_path / "board"), "--square", str(SQUARE_M)]
    assert calibrate.main([*words, "--size", "640", "480"]) == 2
    assert "board: 1280x960 px, but --size says 640x480: leave --size out" in capsys.readouterr().err
    assert not (tmp_path / "c.yaml").exists()
    for size in ([], ["--size", "1280", "960"]):
        assert calibrate.main([*words, *size]) == 0
        found = read_cameras(tmp_path / "c.yaml")["dorsal"]
        assert (found.width, found.height) == (1280, 960)
        assert found.fx == pytest.approx(2000.0, rel=0.01)


def test_a_kept_lens_says_the_size(tmp_path, rng, capsys):
    (tmp_path / "known.yaml").write_text(yaml.safe_dump({"dorsal": BIG}))
    words = table_of(camera_from_mapping(BIG, "dorsal"), rng, tmp_path)
    words += ["--intrinsics", str(tmp_path / "known.yaml")]
    assert calibrate.main([*words, "--size", "640", "480"]) == 2
    assert "known.yaml: dorsal: 1280x960 px, but --size says 640x480" in capsys.readouterr().err
    assert calibrate.main(words) == 0
    found = read_cameras(tmp_path / "c.yaml")["dorsal"]
    assert (found.width, found.height, found.fx) == (1280, 960, 2000.0)


@pytest.mark.parametrize(
    ("option", "needs"),
    [
        (["--pattern", "7", "5"], "--pattern: only the board of --chessboard or --charuco has one"),
        (["--square", "0.05"], "--square: only the board of --chessboard or --charuco has one"),
        (["--marker", "0.5", "--chessboard", "board"], "--marker: only the board of --charuco has one"),
        (["--dictionary", "5X5_100"], "--dictionary: only the board of --charuco has one"),
    ],
)
def test_calibrate_refuses_what_is_said_of_a_board_that_is_not_there(option, needs, tmp_path, rng, capsys):
    words = table_of(camera_from_mapping(DORSAL, "dorsal"), rng, tmp_path)
    assert calibrate.main([*words, *option]) == 2
    assert needs in capsys.readouterr().err
    assert not (tmp_path / "c.yaml").exists()


def test_calibrate_refuses_a_bad_row(tmp_path, capsys):
    table = tmp_path / "points.csv"
    table.write_text(",".join(calibrate.COLUMNS) + "\n" + "1,2,x,4,5\n" * 7)
    out = tmp_path / "cameras.yaml"
    assert calibrate.main([str(table), "--name", "dorsal", "--plane", "0.1", "--out", str(out)]) == 2
    assert "row 2: x_m: 'x'" in capsys.readouterr().err
    assert not out.exists()


SQUARE_M, TEXTURE = 0.03, 1000.0
"""Side of the boards' squares, and pixels of their print to a metre, of which a square has thirty."""


def chessboard():
    """A board of 9 × 6 inner corners as it is printed, with its white rim."""
    black = np.add.outer(np.arange(7), np.arange(10)) % 2 == 0
    print_ = np.pad(np.kron(~black, np.ones((30, 30))), 30, constant_values=1.0)
    return 20.0 + 210.0 * print_


def charuco():
    """A ChArUco board of 9 × 6 inner corners, likewise."""
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((10, 7), SQUARE_M, 0.75 * SQUARE_M, markers)
    return 20.0 + np.pad(board.generateImage((300, 210)).astype(float), 30, constant_values=255.0) * 210 / 255


def views(texture, lens, rng, near_m=0.42, count=9):
    """Pictures of a board held in front of the camera in different ways."""
    middle = np.array([texture.shape[1], texture.shape[0], 0.0]) / TEXTURE / 2
    for _ in range(count):
        turn = cv2.Rodrigues(rng.uniform((-0.5, -0.5, -0.3), (0.5, 0.5, 0.3)))[0]
        place = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(near_m, near_m + 0.1)])
        yield traced(texture, TEXTURE, lens, turn, place - turn @ middle, rng)


def off_px(lens, found):
    """How far the found lens is off over the view [px]: rays as the true one has them, put through the found one."""
    u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(80, 560, 9), np.linspace(80, 400, 7)))
    x, y = lens.rays(u, v)
    seen = cv2.projectPoints(np.column_stack((x, y, np.ones_like(x))), *np.zeros((2, 3)), *found)[0][:, 0]
    off = seen - np.column_stack((u, v))
    # A shift of all is a turn of the camera, which where it stands makes good.
    return float(np.sqrt(np.mean(np.sum((off - off.mean(axis=0)) ** 2, axis=1))))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "texture", "near_m"), [("chessboard", chessboard, 0.42), ("charuco", charuco, 0.26)]
)
def test_pictures_of_a_board_give_the_lens(option, texture, near_m, tmp_path, rng, capsys):
    """The ChArUco board so near that parts of it are out of view, where a chessboard would not be seen at all."""
    lens = Lens()
    (tmp_path / "board").mkdir()
    for number, picture in enumerate(views(texture(), lens, rng, near_m)):
        cv2.imwrite(str(tmp_path / "board" / f"{number}.png"), picture)
    board = Board((9, 6), SQUARE_M, "4X4_50" if option == "charuco" else "")
    found = lens_from_board(str(tmp_path / "board"), board)
    threads = cv2.getNumThreads()
    again = [lens_from_board(str(tmp_path / "board"), board) for _ in range(3)]
    assert all((one.distortion == found.distortion).all() for one in again)
    assert cv2.getNumThreads() == threads
    assert off_px(lens, (found.matrix, found.distortion)) < 1.0
    assert found.matrix[0, 0] == pytest.approx(lens.focal_px, rel=0.01)
    assert found.distortion[0] == pytest.approx(lens.k1, abs=0.05)
    straight = np.array([[800.0, 0, 319.5], [0, 800.0, 239.5], [0, 0, 1]]), np.zeros(5)
    assert off_px(lens, straight) > 3.0
    # The same from the command line, where points then tell where the camera stands.
    known = camera_from_mapping({**DORSAL, **entry(found, np.array(DORSAL["position_m"]), np.array(DORSAL["rotation"]),
                                                   (640, 480), DORSAL["plane"])}, "dorsal")  # fmt: skip
    words = table_of(known, rng, tmp_path)
    assert calibrate.main([*words, f"--{option}", str(tmp_path / "board"), "--square", str(SQUARE_M)]) == 0
    assert "reprojection error 0.0" in capsys.readouterr().out
    np.testing.assert_allclose(read_cameras(tmp_path / "c.yaml")["dorsal"].distortion, found.distortion, rtol=1e-6)


@pytest.mark.parametrize("option", ["chessboard", "charuco"])
@pytest.mark.parametrize(
    ("pictures", "said"),
    [
        ([np.full((480, 640), 90, np.uint8)] * 3, "is seen in 0 frames, 3 are needed"),
        ([np.full((480, 640), 90, np.uint8), np.full((240, 320), 90, np.uint8)], "320x240 px, the one before 640x480"),
        ([], "is seen in 0 frames"),
    ],
)
def test_pictures_that_give_no_lens_are_refused(option, pictures, said, tmp_path):
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture)
    with pytest.raises(InputError, match=said):
        lens_from_board(str(tmp_path), Board((9, 6), SQUARE_M, "4X4_50" if option == "charuco" else ""))


def test_what_is_no_picture_among_them_is_named(tmp_path):
    (tmp_path / "notes.txt").write_text("square 30 mm")
    with pytest.raises(InputError, match=r"notes.txt: not a readable picture"):
        lens_from_board(str(tmp_path), Board((9, 6), SQUARE_M))
