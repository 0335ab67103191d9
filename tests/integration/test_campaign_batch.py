"""A small batch campaign through rendered video: its bags, its table, resuming it, and stopping it hard."""

import csv
import json
import os
import re
import shutil
import signal

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from sandbot_bringup.plan import read_plan, to_yaml, with_condition
from sandbot_bringup.tools import campaign, unseal
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.film_strip import film_strip

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

PLAN = {"name": "small", "seed": 4, "gait": "UNIFORM", "phi": [0.6, 0.633], "omega_rad_s": [8.0, 20.0], "replicates": 1,
        "periods": 5.0}  # fmt: skip


def write_plan(folder, **changes):
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump({**PLAN, **changes}))
    return path


def rows(folder):
    with (folder / "trials.csv").open() as file:
        return list(csv.DictReader(file))


def bags(folder):
    return sorted(path for path in (folder / "trials").iterdir() if not path.name.startswith("."))


def snapshot(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    plan = write_plan(folder)
    # By worker processes, as usual; all other campaigns here run in this one.
    assert campaign.main([str(plan), "--out", str(folder / "out"), "--batch", "--hide", "3"]) == 0
    return folder / "out"


def test_every_trial_has_a_bag_and_a_row(done):
    assert len(bags(done)) == len(rows(done)) == 4
    walking = next(row for row in rows(done) if row["trial_id"] == "phi0.6330_w08.000_r01")
    assert walking["status"] == "ok"
    assert 0.07 < float(walking["speed_m_s"]) < 0.13
    assert all(walking[name] for name in ("phi_sd", "lift_m", "peak_speed_m_s", "first_step_m"))


@pytest.mark.parametrize("index", range(4))
def test_bags_open_in_strict_readers_and_every_message_deserialises(done, index):
    path = bags(done)[index]
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(path) as reader:
        counted = {}
        for connection, _, data in reader.messages():
            store.deserialize_cdr(data, connection.msgtype)
            counted[connection.topic] = counted.get(connection.topic, 0) + 1
    declared = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert declared["message_count"] == sum(counted.values()) > 500
    assert {
        one["topic_metadata"]["name"]: one["message_count"] for one in declared["topics_with_message_count"]
    } == counted
    with AnyReader([path]) as any_reader:
        assert any_reader.message_count == sum(counted.values())
    with next(path.glob("*.mcap")).open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == sum(counted.values())


def test_a_bag_carries_its_provenance_and_files(done):
    bag = Bag.open(bags(done)[0])
    assert {"id", "plan", "parameters", "software_version", "commit", "start", "clock", "exit_status"} <= set(
        bag.provenance["trial"]
    )
    assert {"campaign.yaml", "cameras.yaml", "robot.yaml"} <= set(bag.attachments)


def test_frames_are_kept_of_one_trial_and_the_truth_only_in_its_place(done):
    kept = [path.name for path in bags(done) if "/camera/lateral/image_raw/compressed" in Bag.open(path).topics]
    assert len(kept) == 1
    world = yaml.safe_load((done / "truth" / "world.yaml").read_text())
    (effect,) = world["effects"]
    said = [path for path in done.rglob("*") if path.is_file() and effect.encode() in path.read_bytes()]
    assert said == [done / "truth" / "world.yaml"]


@pytest.mark.whole  # test_video has them without a campaign
def test_frames_kept_as_video_are_the_raw_ones_to_the_last_bit(batch_campaign, tmp_path):
    plan, frames = write_plan(tmp_path, phi=[0.633], omega_rad_s=[20.0]), {}
    for images in ("raw", "video"):
        assert batch_campaign(plan, "--out", tmp_path / images, "--images", images) == 0
        bag = Bag.open(bags(tmp_path / images)[0])
        assert bool(bag.videos) == (images == "video")
        shown = Timeline(bag, ["/camera/dorsal/image_raw", "/camera/lateral/image_raw"])
        every = [shown[number] for number in range(len(shown))]
        frames[images] = {(one.topic, one.log_time_ns - bag.start_ns): bytes(one.decode().data) for one in every}
    assert len(frames["raw"]) > 250
    assert frames["video"] == frames["raw"]
    assert rows(tmp_path / "video") == rows(tmp_path / "raw")
    assert film_strip(tmp_path / "video") == film_strip(tmp_path / "raw") != []


def test_the_same_seed_gives_the_same_rows(batch_campaign, done, tmp_path):
    assert batch_campaign(write_plan(tmp_path), "--out", tmp_path / "out", "--hide", 3, "--images", "none") == 0
    assert rows(tmp_path / "out") == rows(done)


def test_a_second_run_does_nothing_and_a_lost_bag_is_made_again(batch_campaign, done, capsys):
    before = {path: path.stat().st_mtime_ns for path in bags(done)}
    assert batch_campaign(done) == 0
    assert "4 of 4 trials are there already" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in bags(done)} == before
    table = rows(done)
    shutil.rmtree(bags(done)[1])
    assert batch_campaign(done) == 0
    assert "3 of 4 trials are there already" in capsys.readouterr().out
    assert rows(done) == table


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({"replicates": 2}, (), "replicates: 1 there, 2 now"),
        ({}, ("--hide", "8"), "another world"),
        ({"phi": [0.7]}, (), "phi: 0.7 is outside"),
    ],
)
def test_another_plan_or_world_is_refused_and_nothing_changes(
    batch_campaign, done, tmp_path, capsys, changes, arguments, message
):
    before = snapshot(done)
    assert batch_campaign(write_plan(tmp_path, **changes), "--out", done, *arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert snapshot(done) == before


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(tmp_path, capsys):
    dry = ["--out", str(tmp_path / "out"), "--dry-run"]
    assert campaign.main([str(write_plan(tmp_path)), *dry]) == 0
    assert "4 trials" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()
    assert campaign.main([str(write_plan(tmp_path, cameras="missing.yaml")), *dry]) == 2


def test_next_trials_extend_the_campaign_once(batch_campaign, done, tmp_path, capsys):
    shutil.copytree(done, tmp_path / "more")
    proposals = tmp_path / "next.json"
    proposals.write_text('{"next_trials": [{"phi": 0.61, "omega_rad_s": 12.0, "observable": "lift", "replicates": 1}]}')
    for _ in range(2):
        assert batch_campaign(tmp_path / "more", "--plan", proposals) == 0
        assert len(rows(tmp_path / "more")) == 5
    assert "5 of 5 trials are there already" in capsys.readouterr().out
    # A condition that a live operator added with another gait is run with it, in batch as well.
    file = tmp_path / "more" / "campaign.yaml"
    grown = with_condition(read_plan(file), {"phi": 0.61, "omega_rad_s": 12.0, "replicates": 1, "gait": "SGCS"}, "add")
    file.write_text(to_yaml(grown))
    assert batch_campaign(tmp_path / "more") == 0
    soft, uniform = (row for row in rows(tmp_path / "more") if row["omega_rad_s"] == "12")
    assert (uniform["gait"], soft["gait"]) == ("UNIFORM", "SGCS")
    assert float(soft["peak_speed_m_s"]) > 1.2 * float(uniform["peak_speed_m_s"])


@pytest.mark.parametrize(
    ("how", "code"), [pytest.param(signal.SIGINT, 130, marks=pytest.mark.whole), (signal.SIGKILL, -9)]
)
def test_stopped_at_any_moment_it_leaves_only_whole_bags_and_goes_on(batch_campaign, tmp_path, start, how, code):
    plan = write_plan(tmp_path, omega_rad_s=[20.0, 26.0], replicates=1, images="none")  # short trials
    out = tmp_path / "out"
    process = start("ros2", "run", "sandbot_bringup", "campaign", plan, "--out", out, "--batch")
    process.until(lambda line: re.search(r" [1-3]/4", line) is not None, 120)
    os.killpg(os.getpgid(process.pid), how) if how == signal.SIGINT else os.kill(process.pid, how)
    assert process.wait(60) == code
    for path in bags(out):
        assert Bag.open(path).complete
    assert batch_campaign(out) == 0
    assert len(rows(out)) == len(bags(out)) == 4
    assert not [path for path in (out / "trials").iterdir() if path.name.startswith(".")]


def test_unseal_opens_the_truth(done, tmp_path, capsys):
    (effect,) = yaml.safe_load((done / "truth" / "world.yaml").read_text())["effects"]
    step = {"effects": [], "cv_rmse_m_s": 0.02}
    verdict = {"status": "identified", "effects": [effect], "alternatives": [[effect]], "because": "it does"}
    found = tmp_path / "discovery.json"
    content = {"schema": "sandbot.discovery/1", "steps": [step], "noise_floor_m_s": 0.005, "verdict": verdict}
    found.write_text(json.dumps(content))
    assert unseal.main([str(done), "--discovery", str(found)]) == 0
    assert "truth:   agrees" in capsys.readouterr().out
    found.write_text(json.dumps({**content, "verdict": {**verdict, "effects": ["cohesion"]}}))
    assert unseal.main([str(done), "--discovery", str(found)]) == 1
    found.write_text('{"schema": "sandbot.discovery/1"}')
    assert unseal.main([str(done), "--discovery", str(found)]) == 2
