"""What spoils film, each by itself, beside the same camera whose film nothing spoils."""

import numpy as np
import pytest
import yaml

from sandbot_bringup.config import config_folder
from sandbot_common.errors import InputError
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.cameras import LabCamera
from sandbot_lab.degradation import MAX_JITTER
from sandbot_lab.film import Film
from sandbot_lab.world import World, read_world, write_world

CAMERAS = read_yaml(config_folder() / "cameras.yaml")
X_M, Z_M = 0.5, 0.03


def frame(film=None, t_s=0.0, name="dorsal"):
    camera = LabCamera(name, CAMERAS[name], 3, film=film)
    return camera.render(X_M, Z_M, t_s=t_s).astype(float)


def test_film_that_nothing_spoils_is_as_it_was():
    np.testing.assert_array_equal(frame(Film()), frame(None))
    camera = LabCamera("dorsal", CAMERAS["dorsal"], 3, film=Film())
    assert [camera.instant_s(number) for number in (-2, 0, 7)] == [-0.02, 0.0, 0.07]
    assert {camera.comes(number) for number in range(-50, 50)} == {1}


def test_a_lens_out_of_focus_softens_edges_and_loses_no_light():
    sharp, soft = frame(), frame(Film(defocus_px=3.0))
    steepest = [np.abs(np.diff(one, axis=1)).max() for one in (sharp, soft)]
    assert steepest[1] < 0.6 * steepest[0]
    assert soft.mean() == pytest.approx(sharp.mean(), abs=0.5)


def test_uneven_light_is_whole_amid_and_gone_in_the_corners():
    even, uneven = frame(), frame(Film(uneven=0.3))
    amid, corner = np.s_[230:250, 310:330], np.s_[-20:, -20:]
    assert uneven[amid].mean() == pytest.approx(even[amid].mean(), abs=1.0)
    assert uneven[corner].mean() == pytest.approx(0.7 * even[corner].mean(), rel=0.05)


def test_light_that_flickers_rises_and_falls_with_time():
    film = Film(flicker=0.2, flicker_hz=50.0)
    mean = [frame(film, t_s).mean() / frame().mean() for t_s in (0.0, 0.005, 0.010, 0.015)]
    assert mean == pytest.approx([1.0, 1.2, 1.0, 0.8], abs=0.02)


def test_glints_flash_elsewhere_in_every_frame_and_the_marker_stays():
    first, second = (frame(Film(glints=30), t_s) > 180 for t_s in (0.0, 0.01))
    marker = frame() > 180
    assert first.sum() > marker.sum() + 30
    assert (first & marker).sum() == (second & marker).sum() == marker.sum()
    assert not (first & ~marker & second).any()


def test_a_cable_hides_what_is_behind_it_and_nothing_else():
    hidden, clear = frame(Film(cable_px=10.0)), frame()
    behind = np.s_[:, 252:260]
    assert hidden[behind].mean() < 40 < clear[behind].mean()
    np.testing.assert_array_equal(np.delete(hidden, np.s_[248:264], 1), np.delete(clear, np.s_[248:264], 1))


def test_compression_leaves_a_picture_like_it_and_not_the_same():
    plain, coded = frame(), frame(Film(jpeg_quality=50))
    assert 1.0 < np.sqrt(np.mean((coded - plain) ** 2)) < 10.0


def test_frames_are_lost_or_come_twice_as_often_as_is_said_and_the_same_ones_again():
    film = Film(dropped=0.2, doubled=0.1)
    camera, again, other = (LabCamera(name, CAMERAS[name], 3, film=film) for name in ("dorsal", "dorsal", "lateral"))
    come = np.array([camera.comes(number) for number in range(3000)])
    assert np.mean(come == 0) == pytest.approx(0.2, abs=0.03)
    assert np.mean(come == 2) == pytest.approx(0.08, abs=0.02)
    assert come.tolist() == [again.comes(number) for number in range(3000)]
    assert come.tolist() != [other.comes(number) for number in range(3000)]


def test_instants_scatter_keep_their_order_and_are_one_triggers():
    film, rate_hz = Film(jitter_s=0.002), 100.0
    dorsal, lateral = (LabCamera(name, CAMERAS[name], 3, film=film) for name in ("dorsal", "lateral"))
    instants = np.array([dorsal.instant_s(number) for number in range(-100, 2000)])
    off = instants - np.arange(-100, 2000) / rate_hz
    assert off.std() == pytest.approx(0.002, rel=0.1)
    assert np.abs(off).max() <= MAX_JITTER / rate_hz + 1e-12
    assert (np.diff(instants) > 0).all()
    assert instants.tolist() == [lateral.instant_s(number) for number in range(-100, 2000)]


def test_instants_that_scatter_more_than_the_frame_rate_allows_are_refused():
    LabCamera("dorsal", CAMERAS["dorsal"], 3, film=Film(jitter_s=0.004))
    with pytest.raises(InputError, match=r"film: jitter_s: 0\.005 s is too much at 100 frames/s.* at most 0\.004 s"):
        LabCamera("dorsal", CAMERAS["dorsal"], 3, film=Film(jitter_s=0.005))


def test_a_world_keeps_its_film_and_says_nothing_of_one_that_is_sound(tmp_path):
    world = World(film=Film(defocus_px=1.5, glints=5))
    write_world(world, tmp_path / "bad.yaml")
    assert read_world(tmp_path / "bad.yaml") == world
    write_world(World(), tmp_path / "sound.yaml")
    assert "film" not in yaml.safe_load((tmp_path / "sound.yaml").read_text())


@pytest.mark.parametrize(
    ("film", "words"),
    [({"defocus": 1}, "defocus_px"), ({"dropped": 2}, "dropped"), ({"jpeg_quality": "bad"}, "jpeg_quality")],
)
def test_what_no_film_can_be_is_refused_by_file_and_key(film, words, tmp_path):
    (tmp_path / "w.yaml").write_text(yaml.safe_dump({"film": film}))
    with pytest.raises(InputError, match=f"w.yaml: film.*{words}"):
        read_world(tmp_path / "w.yaml")
