"""Cameras of which nothing is known but their pictures: one that falls silent or is knocked has the legs at rest."""

import os
import signal
import sys
import time

import pytest

from sandbot_common import topics
from sandbot_common.ros import endpoints
from sandbot_record.bags.reader import Bag

# How campaign and tracker react is tested without nodes in test_monitor_node.py and test_camera_faults.py.
pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(300)]
WALK_S = 30.0
"""A trial so long that no busy machine ends it before it is stopped."""
NODES = ("sandbot_clock.nodes.clock_node", "sandbot_bed.nodes.bed_node")
DRIVER = """
import signal, sys
import numpy as np
from sandbot_common.ros.node import spin_once, use_shared_memory
use_shared_memory(frames=True)
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Image

knocks = []
signal.signal(signal.SIGUSR1, lambda *_: knocks.append(10))
rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
node = rclpy.create_node("usb_cam_" + sys.argv[1])
shown = node.create_publisher(Image, f"/camera/{sys.argv[1]}/image_raw", 50)

def show(image):
    if knocks:
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
        image.data = np.roll(pixels, sum(knocks), axis=1).tobytes()
    shown.publish(image)

node.create_subscription(Image, f"/filmed/{sys.argv[1]}", show, 50)
executor = SingleThreadedExecutor()
executor.add_node(node)
while True:
    executor.spin_once(timeout_sec=0.02)
"""
"""A driver without any report of its health, which films what the virtual lab shows; knocked by 10 px on SIGUSR1."""


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (signal.SIGSTOP, "the lateral camera is silent: no new frame for 1 s"),
        (signal.SIGUSR1, "the tracker is blind: lateral: the camera has moved by 10.0 px"),
    ],
)
def test_legs_rest_once_a_camera_of_anybody_is_silent_or_knocked(
    fault, said, tmp_path, start, plan_of_one, beside, slow_cameras
):
    states = []
    endpoints.subscription(beside.node, topics.LEG_STATES, states.append)

    def run(module, *given):
        return start(sys.executable, "-c", f"from {module} import main; raise SystemExit(main())", *given)

    for module in NODES:
        run(module)
    filmed = [word for view in topics.VIEWS for word in ("-r", f"/camera/{view}/image_raw:=/filmed/{view}")]
    given = "--ros-args", "-p", f"cameras:={slow_cameras}"
    run("sandbot_lab.nodes.lab_node", *given, *filmed)
    run("sandbot_tracking.nodes.tracker_node", *given)
    drivers = {view: start(sys.executable, "-c", DRIVER, view) for view in topics.VIEWS}
    plan = plan_of_one(min_duration_s=WALK_S, standing_s=0.5, cameras=str(slow_cameras))
    live = run("sandbot_bringup.tools.campaign", plan, "--out", tmp_path / "live")
    beside.until(lambda: live.ended or (states and any(states[-1].velocity)), 120.0)
    assert not live.ended, live.lines
    beside.wait(lambda: not any(states[-1].velocity), 2.0)  # both cameras have been seen
    os.kill(drivers["lateral"].pid, fault)
    struck_s = time.monotonic()
    beside.until(lambda: not any(states[-1].velocity), WALK_S)
    assert time.monotonic() - struck_s < WALK_S / 2
    os.kill(drivers["lateral"].pid, signal.SIGCONT)
    live.until(lambda line: f"failed: {said}" in line)
    live.wait(60)
    (aside,) = (tmp_path / "live" / "trials" / ".partial").iterdir()
    assert said in Bag.open(aside).provenance["trial"]["exit_status"]
    assert not list((tmp_path / "live" / "trials").glob("phi*"))
