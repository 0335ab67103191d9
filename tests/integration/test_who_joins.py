"""Who joins nodes that run already hears them at once, also in the place of one that was killed."""

import contextlib
import os
import subprocess
import sys

import pytest

from sandbot_common.dead_ports import SHARED_MEMORY, dead_ports

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SPEAKER = """
import time
import numpy as np, rclpy
from sandbot_common import messages, topics
from sandbot_common.ros.endpoints import publisher
from sandbot_common.ros.node import use_shared_memory
use_shared_memory(frames=False)
rclpy.init()
legs, zero = publisher(rclpy.create_node("speaker"), topics.LEG_STATES), np.zeros(6)
print("up", flush=True)
while True:
    legs.publish(messages.joint_state(time.time_ns(), topics.LEGS, zero, zero, zero))
    time.sleep(0.02)
"""
LISTENER = """
import sys, time
from rclpy.node import Node
from sandbot_common import topics
from sandbot_common.ros.endpoints import subscription
from sandbot_common.ros.node import run

class Listener(Node):
    def __init__(self):
        begun, self.done = time.monotonic(), False
        super().__init__("listener")
        subscription(self, topics.LEG_STATES, lambda message: self.hear(time.monotonic() - begun))

    def hear(self, after_s):
        print(after_s, flush=True)
        self.done = "stay" not in sys.argv

sys.exit(run(Listener, []))
"""


@pytest.fixture
def speaker(domain):
    """Somebody who publishes all the time."""
    with subprocess.Popen([sys.executable, "-c", SPEAKER], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "up\n"
            yield
        finally:
            process.kill()


@contextlib.contextmanager
def listener():
    """One who has heard the speaker, and is killed."""
    with subprocess.Popen([sys.executable, "-c", LISTENER, "stay"], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline()
            yield
        finally:
            process.kill()


def test_who_joins_hears_within_a_second_and_a_half(speaker):
    # Announced every 3 s, as DDS has it by itself, every other one waits for 2.4 s.
    command = [sys.executable, "-c", LISTENER]
    waits = [
        float(subprocess.run(command, capture_output=True, check=True, text=True).stdout.split()[0]) for _ in range(8)
    ]
    assert sorted(waits)[-3] < 1.5, waits


def test_nobody_takes_the_number_of_one_that_was_killed(speaker, domain):
    assert dead_ports(domain) == []
    with listener():
        assert dead_ports(domain) == []
    killed = dead_ports(domain)
    assert len(killed) == 1
    with listener():
        assert dead_ports(domain) == killed


@pytest.mark.timeout(60)
def test_nobody_waits_for_a_port_that_a_killed_one_did_not_finish(speaker, domain):
    half_made = SHARED_MEMORY / f"fastrtps_port{7411 + 250 * domain + 2}"  # the next number's
    half_made.touch()
    os.utime(half_made, (0, 0))
    with listener():
        pass
