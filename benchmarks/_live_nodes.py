"""Nodes of their own process that send pictures or hear what comes of them: argv role, seconds, pictures a second.

``sends`` and ``hears`` are a bare pair; ``dorsal`` and ``lateral`` are drivers of cameras with pictures that were drawn
before; ``speed`` hears /speed, and says where the legs are. Who hears prints the delays [ns] since the stamps.
"""

import sys
import time
from collections.abc import Callable, Iterator
from itertools import cycle
from typing import Any

import numpy as np
import rclpy
from sensor_msgs.msg import Image

from sandbot_bringup import node_table
from sandbot_common import messages, topics
from sandbot_common.ros import endpoints, node
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.cameras import LabCamera

PICTURES, SPEED_M_S, LIFT_M, SEEN_S = 100, 0.2, 0.025, 2.0
LEGS_HZ = 100.0


def main(role: str, seconds: float, rate_hz: float) -> None:
    """Be that node."""
    node.use_shared_memory(frames=role in (*topics.VIEWS, "sends"))
    rclpy.init()
    me = rclpy.create_node(f"live_{role}")
    if role in topics.VIEWS:
        send_every(1 / rate_hz, seconds, driver(me, role, rate_hz))
    elif role == "sends":
        out, picture = me.create_publisher(Image, "bare", 10), np.zeros((480, 640), np.uint8)
        send_every(1 / rate_hz, seconds, lambda: out.publish(messages.image(now_ns(me), "bare", picture)))
    else:
        print(*heard(me, role, seconds))


def now_ns(me: Any) -> int:
    """The host's clock."""
    return int(me.get_clock().now().nanoseconds)


def driver(me: Any, camera: str, rate_hz: float) -> Callable[[], None]:
    """Sends the next picture of a robot that moves to and fro, once somebody has listened for a while."""
    section = read_yaml(node_table.table_path().parent / "cameras.yaml")[camera]
    view = LabCamera(camera, section, seed=3)
    pictures = [view.render(0.3 + SPEED_M_S * n / rate_hz, LIFT_M) for n in range(PICTURES)]
    coming: Iterator[Any] = cycle(pictures + pictures[::-1])
    out = endpoints.publisher(me, topics.VIEWS[camera].image)
    while not out.get_subscription_count():
        time.sleep(0.1)
    time.sleep(SEEN_S)
    return lambda: out.publish(messages.image(now_ns(me), topics.optical_frame(camera), next(coming)))


def send_every(period_s: float, seconds: float, send: Callable[[], None]) -> None:
    """At whole periods of the host's clock: two cameras on one trigger."""
    first = int(time.monotonic() / period_s) + 1
    for n in range(first, first + round(seconds / period_s)):
        time.sleep(max(n * period_s - time.monotonic(), 0.0))
        send()


def heard(me: Any, role: str, seconds: float) -> list[int]:
    """Delays of what came meanwhile."""
    late: list[int] = []

    def hear(message: Any) -> None:
        late.append(now_ns(me) - messages.nanoseconds(message.header.stamp))

    def say() -> None:
        legs.publish(messages.joint_state(now_ns(me), topics.LEGS, still, still, still))

    if role == "hears":
        me.create_subscription(Image, "bare", hear, 10)
    else:
        endpoints.subscription(me, topics.SPEED, hear)
        legs, still = endpoints.publisher(me, topics.LEG_STATES), np.zeros(len(topics.LEGS))
        me.create_timer(1 / LEGS_HZ, say)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(me, timeout_sec=0.1)
    return late


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]))
