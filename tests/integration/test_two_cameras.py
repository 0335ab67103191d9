"""The hardware path: two `camera` nodes, each with a clock of its own, give the row of the trial they filmed."""

import numpy as np
import pytest

from sandbot_common import topics
from sandbot_common.ros.endpoints import subscription
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.trials.from_bags import row_from_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300)]

TRIAL = "phi0.6050_w12.000_r01"
FRAME_MS = 10.0
ROBOT = (topics.TRIAL, topics.BED_PHI, topics.BED_STATUS, topics.LEG_STATES, topics.SYNC_LED)
"""What the trackway itself says; the frames come from the cameras."""
TRACKER = (topics.COM, topics.FRONT_AXLE, topics.REAR_AXLE, topics.SPEED, topics.SPEED_MEAN, topics.LIFT)


def last_words(bag):
    """What the tracker said last on /diagnostics."""
    messages = [message.decode() for message in bag.messages([topics.DIAGNOSTICS.name])]
    said = [status for message in messages for status in message.status if status.name == "tracker"]
    return {pair.key: pair.value for pair in said[-1].values}


def until_shown(beside, films):
    """Wait until that many camera nodes have said on /diagnostics that their film has ended."""
    ended = set()

    def hear(message):
        ended.update(status.name for status in message.status if status.message == "the video has ended")

    heard = subscription(beside.node, topics.DIAGNOSTICS, hear)
    beside.until(lambda: len(ended) >= films, 60.0)
    beside.node.destroy_subscription(heard)


@pytest.mark.whole  # test_camera_drivers has the same nodes and films, one at a time
def test_films_of_a_trial_through_two_camera_nodes_give_its_row(tmp_path, start, plan_of_one, beside):
    batch = start(
        "ros2", "run", "sandbot_bringup", "campaign", plan_of_one(seed=7, images="video"),
        "--out", tmp_path / "batch", "--batch",
    )  # fmt: skip
    assert batch.wait(120) == 0, "\n".join(batch.lines)
    source = tmp_path / "batch" / "trials" / TRIAL

    names = [topic.name for topic in (*ROBOT, *TRACKER, topics.DIAGNOSTICS)]
    record = start("ros2", "run", "sandbot_record", "record", *names, "--out", tmp_path / "filmed")
    record.until(lambda line: line.startswith("recording to"))
    tracker = start("ros2", "run", "sandbot_tracking", "tracker")
    cameras = [
        start(
            "ros2", "run", "sandbot_tracking", "camera", "--ros-args", "-r", f"__node:={name}_camera",
            "-p", "playback:=0.4", "-p", f"camera:={name}", "-p", f"video:={source / f'camera-{name}-image_raw.avi'}",
        )
        for name in ("dorsal", "lateral")
    ]  # fmt: skip
    replay = start(
        "ros2", "run", "sandbot_record", "replay", source, "--delay", "3", "--topics", *(one.name for one in ROBOT)
    )
    assert replay.wait(90) == 0, "\n".join(replay.lines + tracker.lines)
    until_shown(beside, 2)
    for camera in cameras:
        camera.stop()
    tracker.stop()
    record.stop()

    filmed = Bag.open(tmp_path / "filmed")
    speed = filmed.columns(topics.SPEED.name, "twist.twist.linear.x", *FIELD_STAMP)
    before = Bag.open(source).columns(topics.SPEED.name, "twist.twist.linear.x")["twist.twist.linear.x"]
    finite = np.isfinite(speed["twist.twist.linear.x"])
    # The last dorsal frame has no lateral one after it to be joined with.
    assert finite.sum() >= np.isfinite(before).sum() - 5
    one, other = row_from_bag(source), row_from_bag(tmp_path / "filmed")
    assert other.status == "ok"
    # Half a frame is what one LED edge leaves of the clock; the body is nearly at rest where steps end.
    assert other.speed_m_s == pytest.approx(one.speed_m_s, rel=0.01)
    assert other.lift_m == pytest.approx(one.lift_m, abs=1e-4)
    assert other.peak_speed_m_s == pytest.approx(one.peak_speed_m_s, rel=0.03)
    assert other.first_step_m == pytest.approx(one.first_step_m, abs=4e-4)
    means = filmed.columns(topics.SPEED_MEAN.name, "data")["data"]
    assert means[1:].mean() == pytest.approx(other.speed_m_s, rel=1e-3)
    told = last_words(filmed)
    for camera in ("dorsal", "lateral"):
        assert told[f"{camera}_clock"] == "by the LED"
        assert abs(float(told[f"{camera}_clock_offset_ms"])) > FRAME_MS  # how far is when the films were started
        assert told[f"{camera}_dropped"] == told[f"{camera}_doubled"] == told[f"{camera}_clock_jumps"] == "0"
