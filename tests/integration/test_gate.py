"""The gate before a trial: what does not run as it must is named, and the campaign ends, before anything blows."""

import sys

import pytest

from sandbot_record.bags.reader import Bag

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(300)]
NODES = ("sandbot_clock.clock_node", "sandbot_bed.bed_node", "sandbot_lab.lab_node", "sandbot_tracking.tracker_node")
RARE = {"min_readings": 500, "average_s": 0.2, "pulse_off_s": 0.3, "fluidise_s": 0.7}
"""A bed that needs more heights a second than the lab's sensor gives: 50."""


def test_heights_too_rare_to_prepare_with_end_the_campaign(tmp_path, start, plan_of_one):
    for module in NODES:
        start(sys.executable, "-c", f"from {module} import main; raise SystemExit(main())")
    witness = start("ros2", "run", "sandbot_record", "record", "/bed/blower", "--out", tmp_path / "witness")
    witness.until(lambda line: line.startswith("recording to"))
    live = start("ros2", "run", "sandbot_bringup", "campaign", plan_of_one(bed=RARE), "--out", tmp_path / "live")
    assert live.wait(200) == 2
    (said,) = [line for line in live.lines if "/bed/height" in line]
    assert "are needed; mend it, then start the campaign again to go on" in said
    witness.stop()
    assert not Bag.open(tmp_path / "witness").columns("/bed/blower", "data")["data"].any()
    assert not list((tmp_path / "live" / "trials").glob("phi*"))
