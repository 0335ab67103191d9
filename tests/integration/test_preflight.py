"""What ends a campaign with a sentence: a preflight check that fails, trials that fail alike, a folder of another's."""

import pytest

from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.plan import read_plan
from sandbot_bringup.streak import ALIKE
from sandbot_record.bags.reader import Bag

pytestmark = [
    *(pytest.mark.ros, pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(300)),
    pytest.mark.usefixtures("nodes_of_a_trial"),
]
RARE = {"min_readings": 500, "average_s": 0.2, "pulse_off_s": 0.3, "fluidise_s": 0.7}
"""A bed that needs more heights a second than the lab's sensor gives: 50."""
WEAK = {"max_pulses": 1, "pulse_off_s": 0.3, "fluidise_s": 0.7, "settle_s": 0.4, "average_s": 0.2}
"""A bed that no pulse prepares."""


def test_heights_too_rare_to_prepare_with_end_the_campaign(tmp_path, start, plan_of_one):
    witness = start("ros2", "run", "sandbot_record", "record", "/bed/blower", "--out", tmp_path / "witness")
    witness.until(lambda line: line.startswith("recording to"))
    live = start("ros2", "run", "sandbot_bringup", "campaign", plan_of_one(bed=RARE), "--out", tmp_path / "live")
    assert live.wait(200) == 2
    (said,) = [line for line in live.lines if "/bed/height" in line]
    assert "are needed; fix it, then start the campaign again to go on" in said
    witness.stop()
    assert not Bag.open(tmp_path / "witness").columns("/bed/blower", "data")["data"].any()
    assert not list((tmp_path / "live" / "trials").glob("phi*"))


@pytest.mark.timeout(900)
def test_trials_that_fail_alike_end_the_campaign(tmp_path, start, plan_of_one):
    plan, out = plan_of_one(bed=WEAK, replicates=3 * ALIKE), tmp_path / "live"
    live = start("ros2", "run", "sandbot_bringup", "campaign", plan, "--silence", "5", "--out", out)
    assert live.wait(600) == 2
    (said,) = [line for line in live.lines if "in a row failed alike" in line]
    assert "target not reached after 1 pulses" in said
    assert said.endswith("fix it, then start the campaign again to go on")
    # No more than those, and what a busy machine spoilt before them.
    assert ALIKE <= len(list((out / "trials" / ".partial").glob("phi*"))) < 3 * ALIKE


def test_a_folder_has_one_live_campaign(tmp_path, start, plan_of_one):
    plan, folder = plan_of_one(), CampaignFolder(tmp_path / "live")
    folder.adopt(read_plan(plan), {})
    with folder.locked():
        live = start("ros2", "run", "sandbot_bringup", "campaign", plan, "--out", folder.path)
        assert live.wait(200) == 2
    assert "another campaign is running into it" in live.lines[-1]
    assert not folder.trials.exists()
