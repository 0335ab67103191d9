"""A bag replayed over DDS into the real tracker and predictor gives the row that the bag itself gives."""

import numpy as np
import pytest

from sandbot_common import topics
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.from_bags import row_from_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(600)]

TRIAL = "phi0.6050_w12.000_r01"
GIVEN = (
    topics.TRIAL, topics.BED_PHI, topics.BED_STATUS, topics.SYNC_LED, topics.LEG_STATES, topics.DORSAL_IMAGE,
    topics.LATERAL_IMAGE,
)  # fmt: skip
"""What the robot, the bed and the cameras say; all else is the nodes' to find out anew."""
SAID = (
    topics.COM, topics.FRONT_AXLE, topics.REAR_AXLE, topics.SPEED, topics.SPEED_MEAN, topics.LIFT, topics.MODEL_SPEED,
    topics.MODEL_SPEED_MEAN, topics.MODEL_ERROR,
)  # fmt: skip

WITHIN = {"raw": (1e-4, 1e-6, 1e-4, 1e-6), "jpeg": (0.01, 1e-4, 0.02, 3e-4)}
"""Speed (relative), lift [m], peak speed (relative), first step [m]: the same frames, or what JPEG leaves of them."""


TRACKED = (topics.COM.name, topics.SPEED_MEAN.name, topics.LIFT.name)


def counts(bag, names):
    """How many messages of each topic a bag holds, one that is being written as well."""
    there = Bag.open(bag, strict=False).topics
    return [there[name].count if name in there else 0 for name in names]


# test_bags_live compares what is replayed with what was recorded; make demo replays into another tracker.
@pytest.mark.whole
@pytest.mark.parametrize("images", ["raw", "jpeg"])
def test_replay_into_tracker_and_predictor_gives_the_same_row(tmp_path, start, beside, plan_of_one, images):
    plan = plan_of_one(seed=7, images=images)
    batch = start("ros2", "run", "sandbot_bringup", "campaign", plan, "--out", tmp_path / "batch", "--batch")
    assert batch.wait(200) == 0, "\n".join(batch.lines)
    source = tmp_path / "batch" / "trials" / TRIAL

    tracker = start("ros2", "run", "sandbot_tracking", "tracker")
    start("ros2", "run", "sandbot_model", "predictor")
    played = [topic.name for topic in GIVEN]
    command = ("ros2", "run", "sandbot_record", "replay", "--delay", "3", "--rate", "0.25")
    decoded = ["--decode-jpeg"] if images == "jpeg" else []
    replay = start(*command, *decoded, source, "--topics", *played)
    replay.strike(" ")  # it begins paused: everybody is to meet everybody first
    names = [topic.name for topic in (*SAID, *GIVEN) if "image" not in topic.name]
    record = start("ros2", "run", "sandbot_record", "record", *names, "--out", tmp_path / "again")
    record.until(lambda line: line.startswith("recording to"))
    replay.strike(" ")
    assert replay.wait(200) == 0, "\n".join(replay.lines + tracker.lines)
    before = Bag.open(source)
    # The tracker may still be at the last frames; the recorder writes out what it has once a second.
    beside.wait(lambda: counts(tmp_path / "again", TRACKED) == counts(source, TRACKED), 60.0)
    record.stop()
    assert counts(tmp_path / "again", TRACKED) == counts(source, TRACKED)
    assert "0 lost" in record.lines[-1]

    after = Bag.open(tmp_path / "again")
    one, other = row_from_bag(source), row_from_bag(tmp_path / "again")
    assert other.status == "ok"
    told = ("trial_id", "phi", "phi_sd", "omega_rad_s", "gait", "replicate")
    assert [getattr(other, name) for name in told] == [getattr(one, name) for name in told]
    speed, lift, peak, step = WITHIN[images]
    assert other.speed_m_s == pytest.approx(one.speed_m_s, rel=speed)
    assert other.lift_m == pytest.approx(one.lift_m, abs=lift)
    assert other.peak_speed_m_s == pytest.approx(one.peak_speed_m_s, rel=peak)
    assert other.first_step_m == pytest.approx(one.first_step_m, abs=step)

    means, again = (bag.columns(topics.SPEED_MEAN.name, "data")["data"] for bag in (before, after))
    assert len(means) == len(again)
    np.testing.assert_allclose(again, means, rtol=0.01)
    lifts, again = (bag.columns(topics.LIFT.name, "data")["data"] for bag in (before, after))
    np.testing.assert_allclose(again, lifts, atol=2e-4)
    assert after.topics[topics.MODEL_SPEED.name].count > 0.9 * after.topics[topics.LEG_STATES.name].count
    last = {
        topic: after.columns(topic.name, "data")["data"][-1]
        for topic in (topics.SPEED_MEAN, topics.MODEL_SPEED_MEAN, topics.MODEL_ERROR)
    }
    assert last[topics.MODEL_ERROR] == pytest.approx(last[topics.SPEED_MEAN] - last[topics.MODEL_SPEED_MEAN], abs=1e-9)
    assert last[topics.MODEL_SPEED_MEAN] == pytest.approx(last[topics.SPEED_MEAN], rel=0.5)
