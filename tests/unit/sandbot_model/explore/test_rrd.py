"""A trial as a Rerun recording: what its lines are, on both timelines, and what is said where Rerun is missing."""

import errno
import os
import sys
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from made_up import PACE

from sandbot_common.errors import InputError
from sandbot_model.explore import clip, rrd
from sandbot_model.explore import scene as scenes
from sandbot_model.tools import arguments
from sandbot_model.tools.export import main as export
from sandbot_record.bags.reader import Bag


@pytest.fixture(scope="module")
def bag(bags):
    return Bag.open(next(iter(bags.values())))


def by_name(scene, bag):
    return {one.entity: one for one in rrd.series(scene, bag)}


def test_measured_error_model_and_residual_are_lines(scene, bag):
    found = by_name(scene, bag)
    measured, model = found["speed/measured"], found["speed/model"]
    assert measured.value == pytest.approx(0.1 + 0.05 * np.sin(2 * PACE * measured.time_s), abs=1e-9)
    # The bag states a variance of 1e-4 m²/s².
    assert found["speed/measured_plus_sd"].value - measured.value == pytest.approx(0.01)
    assert measured.value - found["speed/measured_minus_sd"].value == pytest.approx(0.01)
    at = np.interp(measured.time_s, model.time_s, model.value)
    assert found["residual/measured_minus_model"].value == pytest.approx(measured.value - at)
    assert np.ptp(found["residual/measured_minus_model"].value) > 0.01
    assert set(found) <= set(rrd.LINES)
    assert not any(name.startswith("bed/") for name in found), "the bag knows nothing of a bed"


def test_the_phase_is_what_the_first_tripod_has_turned(scene):
    assert rrd.phase_deg(scene, np.array([-0.1, 0.0, 0.25, 0.5])) == pytest.approx(
        np.rint(np.rad2deg([0.0, 0.0, 0.25 * PACE, 0.5 * PACE])), abs=1
    )


def test_without_rerun_one_line_says_what_to_install(monkeypatch, scene, bag, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match="make rerun"):
        rrd.write_rrd(tmp_path / "t.rrd", scene, bag, None)
    assert export([str(tmp_path), "--trial", "t", "--out", str(tmp_path / "t.rrd")]) == 2
    said = capsys.readouterr().err
    assert "rerun-sdk, which is not installed" in said
    assert len(said.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["t.avi", "t", "no/such/folder/t.rrd"])
def test_a_file_that_can_not_be_written_is_refused(name, tmp_path, capsys):
    assert export([str(tmp_path), "--trial", "t", "--out", str(tmp_path / name)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_what_was_written_is_read_back(scene, bag, tmp_path):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    jpeg = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    film = SimpleNamespace(time_s=np.arange(0.0, 0.5, 0.1), jpeg=lambda i: jpeg)
    rrd.write_rrd(tmp_path / "t.rrd", scene, bag, film)
    assert [path.name for path in tmp_path.iterdir()] == ["t.rrd"]
    rows = {}
    for chunk in RrdReader(str(tmp_path / "t.rrd")).stream():
        if not chunk.is_static:
            assert set(chunk.timeline_names) == {"time", "leg_phase"}
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    assert rows == {"/film": 5} | {f"/{name}": len(one.value) for name, one in by_name(scene, bag).items()}


@pytest.mark.parametrize("full", [True, False])
def test_a_full_disk_is_told_in_one_line(full, scene, bags, tmp_path, monkeypatch, capsys):
    def write(part, *_):
        part.write_bytes(b"clip")
        if full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(arguments, "ladder", lambda _: (None, "robot: any", [None]))
    monkeypatch.setattr(scenes, "scene_of", lambda *_: scene)
    monkeypatch.setattr(clip, "write_clip", write)
    name, path = next(iter(bags.items()))
    assert export([str(path), "--trial", name, "--out", str(tmp_path / "t.mp4")]) == (2 if full else 0)
    said = capsys.readouterr().err
    assert said.count("\n") == full
    assert ("t.mp4: can't be written: No space left on device" in said) is full
    assert (tmp_path / "t.mp4").exists() is not full


def test_a_table_has_no_trial_to_export_and_what_has_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.csv").write_text("trial_id,phi,omega_rad_s,speed_m_s\nt1,0.63,16,0.2\n")
    assert export(["one.csv", "--trial", "t1", "--out", "x.mp4"]) == 2
    assert (
        ": error: trial 't1' is of a table; v_x(t) and film need a campaign folder or bags\n" in capsys.readouterr().err
    )
