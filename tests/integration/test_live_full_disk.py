"""A recorder that ends in the middle of a live trial: the legs stop, the reason is said, the bag is readable."""

import re

import pytest

from sandbot_bringup.plan import read_plan
from sandbot_record.bags.reader import FIELD_STAMP, Bag

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(600)]

KIB = 900
"""Room for some seconds of the trial, more where a busy machine renders fewer frames: its walk is of 50 s."""


def test_a_full_disk_stops_the_legs_and_says_why(tmp_path, start, plan_of_one, quick_bed):
    plan = plan_of_one(omega_rad_s=[0.5])
    start("ros2", "launch", "sandbot_bringup", "trackway.launch.py", *quick_bed)
    witness = start("ros2", "run", "sandbot_record", "record", "/leg_states", "--out", tmp_path / "witness")
    witness.until(lambda line: line.startswith("recording to"))
    campaign = f"ros2 run sandbot_bringup campaign {plan} --silence 10 --out {tmp_path / 'live'}"
    live = start("bash", "-c", f"ulimit -f {KIB}; exec {campaign}")
    assert live.wait(500) == 1, "\n".join(live.lines)
    witness.stop()

    # Its own word, or its end, whichever is heard first.
    said = re.compile(r"failed: the recorder (failed|ended): .*File too large")
    assert any(said.search(line) for line in live.lines), "\n".join(live.lines)
    (bag,) = (tmp_path / "live" / "trials" / ".partial").iterdir()
    assert Bag.open(bag).count > 0

    legs = Bag.open(tmp_path / "witness").columns("/leg_states", "velocity", *FIELD_STAMP)
    moving = (legs["velocity"] != 0.0).any(axis=1)
    assert moving.any()
    assert not moving[-1]
    walked_s = (legs.stamp_ns[moving][-1] - legs.stamp_ns[moving][0]) * 1e-9
    assert walked_s < 0.9 * read_plan(plan).duration_s(0.5)
