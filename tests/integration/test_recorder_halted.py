"""A recorder that is paused or stopped while the robot walks: nobody walks on unrecorded, and the trial is not ok."""

import json
import sys
import time

import pytest
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from sandbot_common import topics
from sandbot_common.ros import endpoints
from sandbot_record.bags.reader import Bag

# Each is a case of "nobody records", of which tests/faults/test_matrix.py samples one.
pytestmark = [
    *(pytest.mark.ros, pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(300)),
    pytest.mark.usefixtures("nodes_of_a_trial"),
]
WALK_S = 30.0
"""A trial so long that no busy machine ends it before it is stopped."""


@pytest.mark.parametrize(
    ("service", "kind", "request_", "said"),
    [
        ("/recorder/pause", SetBool, SetBool.Request(data=True), "the recorder paused: nothing is recorded"),
        ("/recorder/stop", Trigger, Trigger.Request(), "the recorder stopped: nothing is recorded"),
    ],
)
def test_legs_stop_with_their_recorder(service, kind, request_, said, tmp_path, start, plan_of_one, beside):
    stages, states = [], []
    endpoints.subscription(
        beside.node, topics.CAMPAIGN_STATUS, lambda status: stages.append(json.loads(status.data)["stage"])
    )
    endpoints.subscription(beside.node, topics.LEG_STATES, states.append)
    plan = plan_of_one(min_duration_s=WALK_S, standing_s=0.5)
    live = start("ros2", "run", "sandbot_bringup", "campaign", plan, "--silence", "5", "--out", tmp_path / "live")
    beside.until(lambda: states and any(states[-1].velocity), 120.0)
    halt = beside.node.create_client(kind, service)
    beside.until(halt.service_is_ready)
    halt.call_async(request_)
    asked_s = time.monotonic()
    beside.until(lambda: not any(states[-1].velocity), 20.0)
    assert time.monotonic() - asked_s < WALK_S / 2
    live.until(lambda line: line.endswith(f"failed: {said}"))
    live.wait(60)
    (aside,) = (tmp_path / "live" / "trials" / ".partial").iterdir()
    assert Bag.open(aside).provenance["trial"]["exit_status"] != "ok"
    assert not list((tmp_path / "live" / "trials").glob("phi*"))


DEAF = """
import sys
from types import SimpleNamespace
from sandbot_bringup import recorder_process
from sandbot_bringup.nodes import campaign_node
from sandbot_bringup.tools.campaign import main
from sandbot_common.topics import Topic

campaign_node.DISCOVERY_S = 5.0
recorder_process.topics = SimpleNamespace(ALL=(Topic("/nobody", "std_msgs/msg/String"),))
raise SystemExit(main(sys.argv[1:]))
"""
"""A campaign whose recorder listens to a topic on which nobody speaks."""


def test_nobody_walks_for_a_recorder_that_hears_nobody(tmp_path, start, plan_of_one, beside):
    stages = []
    endpoints.subscription(
        beside.node, topics.CAMPAIGN_STATUS, lambda status: stages.append(json.loads(status.data)["stage"])
    )
    beside.node.create_publisher(String, "/nobody", 1)
    plan = plan_of_one(min_duration_s=WALK_S, standing_s=0.5)
    live = start(sys.executable, "-c", DEAF, plan, "--silence", "5", "--out", tmp_path / "live")
    beside.until(lambda: live.ended, 120.0)
    live.until(lambda line: "failed: the recorder receives nothing" in line)
    assert "standing" in stages
    assert "walking" not in stages
