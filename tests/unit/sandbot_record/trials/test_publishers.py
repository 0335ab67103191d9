"""A bag with messages of another trial on its topics gives no row that is ok."""

import json
import math

import bags
import pytest

from sandbot_common import messages, topics
from sandbot_record.trials.from_bags import row_from_bag

PHI = 0.6213
"""What the bed says in every bag of these tests."""
T0_NS = bags.T0 + 300_000_000


def phi(t_s, value):
    return topics.BED_PHI, t_s, messages.float64(value)


def status(t_s, value, stage="ready"):
    return topics.BED_STATUS, t_s, messages.diagnostics(0, "bed", {"stage": stage, "phi": value, "phi_sd": 0.001})


def com(t_s, stamp_s):
    stamp_ns = T0_NS + round(stamp_s * 1e9)
    return topics.COM, t_s, messages.point(stamp_ns, (0.1, 0.0, math.nan))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ([], "ok"),
        # Of the bed's own status, and of that while it was being prepared and since.
        ([status(-0.2, 0.58), status(-0.1, PHI), status(1.0, PHI), status(1.1, PHI)], "ok"),
        ([status(-0.1, 0.58, "settle"), status(-0.05, PHI), status(4.2, math.nan, "idle")], "ok"),
        ([status(-0.1, "of sorts")], "ok"),
        ([phi(-0.2, 0.6), phi(-0.1, PHI)], "ok"),  # the result of the trial before, still latched
        ([status(-0.1, PHI), phi(1.0, 0.618)], "bed: φ 0.6213 in /bed/volume_fraction, 0.6180 in /bed/volume_fraction"),
        ([status(-0.1, 0.6)], "bed: φ 0.6213 in /bed/volume_fraction, 0.6000 in /bed/status"),
        ([status(-0.1, PHI), status(1.0, 0.6)], "bed: φ 0.6213 in /bed/volume_fraction, 0.6000 in /bed/status"),
    ],
)
def test_phi_is_that_of_the_preparation(tmp_path, more, said):
    assert row_from_bag(bags.trial_bag(tmp_path / "b", more=more)).status == said


def test_phi_of_a_bed_that_says_nothing_more(tmp_path):
    bare = {"without": (topics.BED_STATUS.name,)}
    assert row_from_bag(bags.trial_bag(tmp_path / "one", **bare)).status == "ok"
    assert row_from_bag(bags.trial_bag(tmp_path / "two", more=[phi(1.0, 0.618)], **bare)).status.startswith("bed: φ")


@pytest.mark.parametrize(
    ("plan", "said"), [(bags.PLAN, "ok"), (bags.PLAN | {"trial_id": "other"}, "2 different trials on /trial")]
)
def test_a_bag_is_of_one_trial(tmp_path, plan, said):
    more = [(topics.TRIAL, 1.0, messages.string(json.dumps(plan)))]
    assert row_from_bag(bags.trial_bag(tmp_path / "b", more=more)).status == said


def test_a_trial_starts_once(tmp_path):
    more = [(topics.SYNC_LED, 1.0, messages.header(T0_NS - 10**12, "sync_led"))]
    assert row_from_bag(bags.trial_bag(tmp_path / "b", more=more)).status == "2 edges on /sync_led, a trial has one"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ([com(1.002, -3600.0), com(1.012, -3599.99)], "tracking: 2 messages on /landmarks/com are of an earlier time"),
        ([com(-0.1, -0.55), com(-0.09, -3600.0)], "ok"),  # a camera whose clock was off until it saw the LED
        ([com(0.001, -5.0)], "ok"),  # it waited for the camera's clock
    ],
)
def test_landmarks_of_another_day_are_told(tmp_path, more, said):
    assert row_from_bag(bags.trial_bag(tmp_path / "b", more=more)).status == said
