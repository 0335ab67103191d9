"""Pixels to metres and back, lens distortion and refusals."""

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import camera_from_mapping, read_cameras
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
    ],
)
def test_bad_cameras_are_refused_by_name(change, message):
    with pytest.raises(InputError, match=message) as caught:
        camera_from_mapping({**DORSAL, **change}, "cameras.yaml: dorsal")
    assert str(caught.value).startswith("cameras.yaml: dorsal")
    assert "\n" not in str(caught.value)


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


def test_calibrate_refuses_a_bad_row(tmp_path, capsys):
    table = tmp_path / "points.csv"
    table.write_text(",".join(calibrate.COLUMNS) + "\n" + "1,2,x,4,5\n" * 7)
    out = tmp_path / "cameras.yaml"
    assert calibrate.main([str(table), "--name", "dorsal", "--plane", "0.1", "--out", str(out)]) == 2
    assert "row 2: x_m: 'x'" in capsys.readouterr().err
    assert not out.exists()
