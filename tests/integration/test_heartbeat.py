"""A node whose loop is stuck beats on, and its beats say since when; one that idles turns all the same."""

import sys

import pytest
from std_srvs.srv import Trigger

from sandbot_common import messages, topics
from sandbot_common.ros import endpoints

pytestmark = [pytest.mark.ros, pytest.mark.timeout(120)]

STUCK = """
import time
from rclpy.node import Node
from std_srvs.srv import Trigger
from sandbot_common.ros.node import run

class Stuck(Node):
    def __init__(self):
        super().__init__("stuck")
        self.create_service(Trigger, "wait", lambda *_: time.sleep(4.0))

run(Stuck, [])
"""


def test_the_beats_of_a_stuck_loop_tell_when_it_last_turned(start, beside):
    turns = []
    endpoints.subscription(
        beside.node, topics.HEARTBEAT, lambda beat: turns.append(messages.nanoseconds(beat.stamp)), best_effort=True
    )
    start(sys.executable, "-c", STUCK)
    beside.until(lambda: len(set(turns)) > 5)
    client = beside.node.create_client(Trigger, "wait")
    beside.until(client.service_is_ready)
    client.call_async(Trigger.Request())
    beside.until(lambda: len(turns) > 20 and len(set(turns[-10:])) == 1)
    last_ns = turns[-1]
    turns.clear()
    beside.until(lambda: len(turns) > 5)
    assert set(turns) == {last_ns}
