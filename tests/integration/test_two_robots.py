"""Two trackways on one host, each in a namespace of its own: nothing that is asked of one moves the other."""

import sys

import pytest

from sandbot_common import messages, topics
from sandbot_common.ros import endpoints
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.from_bags import row_from_bag

pytestmark = [pytest.mark.ros, pytest.mark.timeout(300)]

ROBOTS = ("/robot1", "/robot2")


def in_space(space):
    return ("--ros-args", "-r", f"__ns:={space}")


def test_one_start_starts_one_clock_and_a_recorder_hears_its_own_robot(tmp_path, start, beside):
    clocks = [
        start(sys.executable, "-m", "sandbot_clock.nodes.clock_node", *in_space(space), "-p", "late_s:=0.25")
        for space in ROBOTS
    ]
    heard = {space: [] for space in ROBOTS}
    kind = messages.message_class(topics.LEG_SETPOINTS.type)
    for space in ROBOTS:
        beside.node.create_subscription(kind, space + topics.LEG_SETPOINTS.name, heard[space].append, 2000)
    record = start(
        sys.executable, "-m", "sandbot_record.tools.record", "--all", "--out", tmp_path / "bag", *in_space("/robot2")
    )
    name = "/robot2" + topics.LEG_SETPOINTS.name
    beside.until(lambda: "recorder" in endpoints.names_of(beside.node.get_subscriptions_info_by_topic(name)))

    assert beside.call("/robot2/clock/start").success
    beside.until(lambda: len(heard["/robot2"]) > 100)
    assert heard["/robot1"] == []
    assert "was not running" in beside.call("/robot1/clock/stop").message
    assert beside.call("/robot2/clock/stop").message == "stopped"
    assert beside.call("/robot1/clock/start").success  # a clock that walks does not keep the other one from it
    beside.until(lambda: heard["/robot1"])
    assert record.stop() == 0
    # Names in a bag are those of any trackway's; what the other robot did is not in it.
    bag = Bag.open(tmp_path / "bag")
    assert set(bag.topics) <= {topic.name for topic in topics.ALL} | {"/recorder/note"}
    assert bag.topics[topics.LEG_SETPOINTS.name].count > 0

    replay = (sys.executable, "-m", "sandbot_record.tools.replay", tmp_path / "bag", "--delay", "30")
    refused = start(*replay, *in_space("/robot1"))
    assert refused.wait(60) == 2
    refused.until(lambda line: "the trackway is live (/robot1/leg_setpoints is published)" in line)
    assert [clock.stop() for clock in clocks] == [0, 0]


@pytest.mark.slow
@pytest.mark.whole
def test_two_trackways_run_a_trial_each_at_the_same_time(tmp_path, start, plan_of_one, quick_bed, finished):
    speeds = {"robot1": 8.0, "robot2": 12.0}
    for robot in speeds:
        launch = ("ros2", "launch", "sandbot_bringup", "trackway.launch.py", f"namespace:={robot}")
        start(*launch, "lab.phi:=0.605", *quick_bed)
    runs = {}
    for robot, omega in speeds.items():
        plan = plan_of_one(omega_rad_s=[omega]).rename(tmp_path / f"{robot}.yaml")
        run = ("ros2", "run", "sandbot_bringup", "campaign", plan, "--out", tmp_path / robot)
        runs[robot] = (*run, "--silence", "5", *in_space(f"/{robot}"))
    together = {robot: start(*run) for robot, run in runs.items()}
    for robot, campaign in together.items():
        finished(campaign, *runs[robot])
    rows = {robot: row_from_bag(next((tmp_path / robot / "trials").glob("phi*"))) for robot in speeds}
    assert {robot: row.omega_rad_s for robot, row in rows.items()} == speeds
    assert rows["robot1"].speed_m_s < rows["robot2"].speed_m_s
    assert {row.status for row in rows.values()} == {"ok"}
