"""The robot travels with its trials: from the bag or the campaign's folder to whoever reads them."""

import json

import bags
import pytest

from sandbot_common.accuracy import USUAL, Accuracy, accuracy_from_mapping
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot, to_mapping
from sandbot_record.trials import from_bags as table
from sandbot_record.trials.read import read
from sandbot_record.trials.setting import of_cameras

BIG = Robot(leg_radius_m=0.05, mass_per_leg_kg=1.5)


def bag(path, robot=None, trial_id="t"):
    told = {} if robot is None else {"robot": to_mapping(robot)}
    return bags.trial_bag(path, speed=0.2, plan=bags.PLAN | {"trial_id": trial_id} | told)


def test_a_bag_hands_its_robot_and_frame_rate_on(tmp_path):
    trials = read(bag(tmp_path / "b", BIG))
    assert trials.robot == BIG
    assert trials.frame_rate_hz == pytest.approx(100.0)
    assert trials.select(trials.usable).robot == BIG


def test_a_bag_of_an_earlier_version_does_not_tell(tmp_path):
    assert read(bag(tmp_path / "b")).robot is None


def test_trials_of_two_robots_are_refused_naming_both(tmp_path):
    one, other = bag(tmp_path / "one", BIG, "a"), bag(tmp_path / "other", SANDBOT, "b")
    with pytest.raises(InputError, match=r"one and .*other: trials of two robots \(leg_radius_m 0\.05 and 0\.0355, "):
        read([one, other])
    with pytest.raises(InputError, match="trials of two robots"):
        table.campaign(tmp_path)


def test_the_robot_outlives_the_cache_and_the_table(tmp_path):
    for name in "ab":
        bag(tmp_path / "trials" / name, BIG, name)
    assert table.campaign(tmp_path).trials.robot == BIG
    cached = table.campaign(tmp_path)
    assert (cached.cached, cached.trials.robot, cached.trials.frame_rate_hz) == (2, BIG, pytest.approx(100.0))
    table.make(tmp_path)
    assert read(tmp_path).robot == BIG


def test_a_campaigns_robot_file_that_its_bags_contradict_is_refused(tmp_path):
    bag(tmp_path / "trials" / "a", BIG, "a")
    (tmp_path / "robot.yaml").write_text(json.dumps(to_mapping(SANDBOT)), encoding="utf-8")
    with pytest.raises(InputError, match="trials of two robots"):
        table.campaign(tmp_path)


def test_a_mount_beside_the_robot_must_be_the_robots(tmp_path):
    plan = bags.PLAN | {"robot": to_mapping(BIG), "leg_mount_rad": 0.5}
    row = table.row_from_bag(bags.trial_bag(tmp_path / "b", plan=plan))
    assert row.status == "/trial: leg_mount_rad 0.5 is not that of the robot, 0"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("dorsal: {frame_rate_hz: fast}", r"cameras\.yaml: dorsal: frame_rate_hz: 'fast' is not a number"),
        ("dorsal: {frame_rate_hz: 0}", "frame_rate_hz: 0 is outside"),
        ("dorsal: {frame_rate: 250.0}", "dorsal: unknown key 'frame_rate', did you mean 'frame_rate_hz'?"),
        ("dorsal: {frame_rate_hz: 250.0, fx: x}", "dorsal: fx: 'x' is not a number"),
        ("dorsal: {frame_rate_hz: 250.0}\nlateral: 3", "lateral: expected a mapping"),
        ("dorsal: 3", "no camera in it"),
        ("top: {frame_rate_hz: 50.0}", r"cameras\.yaml: no camera is called 'top'; known: dorsal, lateral"),
        ("dorsal: {}\nlatteral: {}", "no camera is called 'latteral', did you mean 'lateral'"),
    ],
)
def test_cameras_that_say_what_is_none(tmp_path, text, words):
    (tmp_path / "cameras.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        of_cameras(tmp_path / "cameras.yaml")


def test_the_slowest_camera_counts(tmp_path):
    text = "dorsal: {frame_rate_hz: 200.0}\nlateral: {frame_rate_hz: 50, fx: 9}"
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    assert of_cameras(tmp_path / "c.yaml") == (50.0, None)


WORSE = "dorsal: {frame_rate_hz: 100.0}\naccuracy: {lift_m: 0.0005}"


def test_a_bag_hands_the_accuracy_of_its_cameras_on(tmp_path):
    path = bags.trial_bag(tmp_path / "b", speed=0.2, files={"cameras.yaml": WORSE})
    assert read(path).accuracy == Accuracy(lift_m=0.0005)
    assert read(bag(tmp_path / "plain")).accuracy is None


def test_the_accuracy_outlives_the_cache_and_the_table(tmp_path):
    for name in "ab":
        plan = bags.PLAN | {"trial_id": name}
        bags.trial_bag(tmp_path / "trials" / name, speed=0.2, plan=plan, files={"cameras.yaml": WORSE})
    for _ in range(2):
        assert table.campaign(tmp_path).trials.accuracy == Accuracy(lift_m=0.0005)
    table.make(tmp_path)
    assert read(tmp_path).accuracy == Accuracy(lift_m=0.0005)


def test_of_several_the_worst_holds(tmp_path):
    one = bags.trial_bag(tmp_path / "one", plan=bags.PLAN | {"trial_id": "a"}, speed=0.2, files={"cameras.yaml": WORSE})
    text = "accuracy: {lift_m: 0.0002, speed_share: 0.01}"
    other = bags.trial_bag(tmp_path / "b", plan=bags.PLAN | {"trial_id": "b"}, speed=0.2, files={"cameras.yaml": text})
    assert read([one, other]).accuracy == Accuracy(lift_m=0.0005, speed_share=0.01)


def test_an_accuracy_that_is_left_out_is_usual_and_one_that_can_not_be_is_refused():
    assert accuracy_from_mapping({}, "c.yaml") == USUAL
    with pytest.raises(InputError, match=r"c\.yaml: accuracy: lift_m: -1.* is outside"):
        accuracy_from_mapping({"lift_m": -1.0}, "c.yaml")
    with pytest.raises(InputError, match=r"c\.yaml: accuracy: unknown key 'lift_mm'"):
        accuracy_from_mapping({"lift_mm": 1.0}, "c.yaml")
