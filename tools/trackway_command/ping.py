"""``ping SECONDS echo`` answers on one topic what it hears on another; ``ping SECONDS PID`` asks it and prints how long
an answer took [s]. The topics carry the answering process's number: nobody else's message is mistaken for ours.
"""

import os
import sys
import time

import rclpy
from std_msgs.msg import String

ASK_S = 0.1


def main(seconds: float, whom: str) -> int:
    """Echo, or ask; 1 if no answer came in time."""
    end = time.monotonic() + seconds
    rclpy.init()
    try:
        return _echo(end) if whom == "echo" else _ask(end, whom)
    finally:
        rclpy.try_shutdown()


def _topic(process: int | str) -> str:
    return f"/doctor/of_{process}"


def _echo(end: float) -> int:
    node = rclpy.create_node("doctor_echo")
    answer = node.create_publisher(String, f"{_topic(os.getpid())}/answer", 10)
    node.create_subscription(String, f"{_topic(os.getpid())}/ask", answer.publish, 10)
    while rclpy.ok() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.2)
    return 0


def _ask(end: float, whom: str) -> int:
    node = rclpy.create_node("doctor_ask")
    ask = node.create_publisher(String, f"{_topic(whom)}/ask", 10)
    took: list[float] = []
    node.create_subscription(
        String, f"{_topic(whom)}/answer", lambda heard: took.append(time.monotonic() - float(heard.data)), 10
    )
    while not took and time.monotonic() < end:
        ask.publish(String(data=repr(time.monotonic())))
        rclpy.spin_once(node, timeout_sec=ASK_S)
    if took:
        print(took[0])
    return 0 if took else 1


if __name__ == "__main__":
    raise SystemExit(main(float(sys.argv[1]), sys.argv[2]))
