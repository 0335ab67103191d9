"""The Python API of sandbot_record and of sandbot_tracking, on a trial of the virtual lab; their examples are run."""

import doctest
from importlib import import_module

import numpy as np
import pytest

import sandbot_record
import sandbot_tracking
from sandbot_common.errors import InputError
from sandbot_model.tools.export import main as export

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

PLAN = "name: api\ngait: UNIFORM\nphi: [0.62]\nomega_rad_s: [12]\nreplicates: 1\nseed: 1\nimages: video\n"


@pytest.fixture(scope="module")
def trial(tmp_path_factory, batch_campaign):
    """A folder with one trial's bag, the videos of both cameras, and their calibration."""
    folder = tmp_path_factory.mktemp("api")
    (folder / "plan.yaml").write_text(PLAN)
    assert batch_campaign(folder / "plan.yaml", "--out", folder / "out") == 0
    (bag,) = (folder / "out" / "trials").iterdir()
    (folder / "trial").symlink_to(bag)
    (folder / "cameras.yaml").symlink_to(folder / "out" / "cameras.yaml")
    for camera in ("dorsal", "lateral"):
        (folder / f"{camera}.avi").symlink_to(bag / f"camera-{camera}-image_raw.avi")
    return folder


@pytest.mark.parametrize(
    "module", ["sandbot_record.bags.reader", "sandbot_record.trials.read", "sandbot_tracking.videos"]
)
def test_the_examples_run(trial, monkeypatch, module):
    monkeypatch.chdir(trial)
    found = doctest.testmod(import_module(module), optionflags=doctest.ELLIPSIS)
    assert found.attempted >= 2
    assert found.failed == 0


def test_messages_come_by_topic_with_their_stamps(trial):
    bag = sandbot_record.Bag.open(trial / "trial")
    both = list(sandbot_record.read(trial / "trial", "/speed", "/lift"))
    assert {message.topic for _, message in both} == {"/speed", "/lift"}
    assert len(both) == bag.topics["/speed"].count + bag.topics["/lift"].count
    assert all(stamp_ns == message.log_time_ns for stamp_ns, message in both)
    assert sum(1 for _ in sandbot_record.read(str(trial / "trial"))) == bag.count


def test_what_is_not_in_the_bag_is_said_before_the_first_message(trial):
    with pytest.raises(InputError, match="no topic /nothing; there are: "):
        sandbot_record.read(trial / "trial", "/speed", "/nothing")
    with pytest.raises(InputError, match="nowhere: no such bag"):
        sandbot_record.read(trial / "nowhere")


def test_a_table_becomes_a_frame_row_by_row(trial):
    pandas = pytest.importorskip("pandas")
    trials = sandbot_record.read_trials(trial / "trial")
    frame = trials.to_frame()
    assert isinstance(frame, pandas.DataFrame)
    assert len(frame) == len(trials) == 1
    assert frame["speed_m_s"][0] == trials.speed_m_s[0]


def test_a_track_agrees_with_the_bag_recorded_beside_the_video(trial):
    found = sandbot_tracking.track(
        trial / "dorsal.avi", trial / "cameras.yaml", lateral=trial / "lateral.avi", omega_rad_s=12.0
    )
    (row,) = sandbot_record.read_trials(trial / "trial").rows()
    assert found.summary.speed_m_s == pytest.approx(row.speed_m_s, rel=0.005)
    assert found.summary.lift_m == pytest.approx(row.lift_m, abs=1e-4)
    assert repr(found).startswith(f"Track of {found.t_s.size} frames, 0 without the centre of mass")
    assert str(found.summary) in repr(found)
    pytest.importorskip("pandas")
    np.testing.assert_array_equal(found.to_frame()["com_x_m"], found.com_m[:, 0])


def test_a_track_without_omega_has_no_observables_and_without_lateral_no_axles(trial):
    cameras = sandbot_tracking.read_cameras(trial / "cameras.yaml")
    found = sandbot_tracking.track(trial / "dorsal.avi", cameras)
    assert found.summary is None
    assert np.isnan(found.front_axle_m).all()
    assert np.isfinite(found.com_m[:, 0]).all()
    assert "\n" not in repr(found)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"omega_rad_s": 500.0}, "omega_rad_s: 500.0 is not a leg frequency"),
        ({"start_s": float("nan")}, "start_s: nan is not a time"),
        ({"video": "nowhere.avi"}, "nowhere.avi: no such video file"),
        ({"lateral": "nowhere.avi"}, "nowhere.avi: no such video file"),
        ({"calibration": {}}, "calibration: no 'dorsal' camera in it"),
        ({"calibration": "nowhere.yaml"}, "nowhere.yaml: no such file"),
    ],
)
def test_a_wrong_argument_is_named(trial, arguments, complaint):
    given = {"video": trial / "dorsal.avi", "calibration": trial / "cameras.yaml", **arguments}
    with pytest.raises(InputError, match=complaint):
        sandbot_tracking.track(**given)


def test_a_trial_is_exported_as_a_clip_and_for_rerun(trial, tmp_path, capsys):
    name = trial.joinpath("trial").resolve().name
    for out in ("clip.mp4", "trial.rrd"):
        if out.endswith("rrd"):
            pytest.importorskip("rerun")
        given = [str(trial / "out"), "--trial", name, "--out", str(tmp_path / out), "--effects", "leg_slip"]
        assert export(given) == 0
        assert capsys.readouterr().out.endswith(f"export: {tmp_path / out}\n")
        assert (tmp_path / out).stat().st_size > 50_000
    assert export([str(trial / "out"), "--trial", "absent", "--out", str(tmp_path / "x.mp4")]) == 2
    assert not (tmp_path / "x.mp4").exists()
