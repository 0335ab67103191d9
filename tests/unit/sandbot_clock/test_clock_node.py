"""The clock node as a real process over DDS."""

import subprocess
import sys
import time

import numpy as np
import pytest

pytestmark = pytest.mark.ros


class Listener:
    """A node beside the one under test, awaiting events."""

    def __init__(self, domain):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from std_srvs.srv import Trigger

        from sandbot_common import node, topics

        self.rclpy, self.trigger, self.ask = rclpy, Trigger, node.ask
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("listener", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.setpoints = []
        node.subscription(self.node, topics.LEG_SETPOINTS, self.setpoints.append)
        self.blower = node.publisher(self.node, topics.BED_BLOWER)

    def wait(self, true, seconds):
        end = time.monotonic() + seconds
        while not true() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)
        return true()

    def until(self, true, seconds=20.0):
        assert self.wait(true, seconds), "waited in vain"

    def call(self, name):
        client = self.node.create_client(self.trigger, name)
        self.until(client.service_is_ready)
        return self.ask(client, self.trigger.Request(), self.wait, 20.0)

    def close(self):
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def listener(domain):
    process = subprocess.Popen([sys.executable, "-m", "sandbot_clock.clock_node"])
    try:
        beside = Listener(domain)
        yield beside
        beside.close()
    finally:
        process.terminate()
        assert process.wait(timeout=10) == 0


def test_runs_on_schedule_stops_at_rest_and_heeds_the_air(listener):
    from sandbot_common.messages import float64, nanoseconds

    assert listener.call("/clock/start").success
    listener.until(lambda: len(listener.setpoints) > 100)
    assert listener.call("/clock/start").message == "was running"  # the answer to the first may have been lost
    refused = listener.call("/clock/home")
    assert not refused.success
    assert listener.call("/clock/stop").success
    listener.until(lambda: not any(listener.setpoints[-1].velocity))
    stamps = np.array([nanoseconds(message.header.stamp) for message in listener.setpoints])
    # Scheduled instants: whole multiples of 5 ms apart to the nanosecond, whatever the machine did.
    assert set(np.diff(stamps) % 5_000_000) == {0}
    angles = np.array([message.position for message in listener.setpoints])
    assert np.all(np.diff(angles, axis=0) >= 0)
    assert all(len(message.effort) == 6 for message in listener.setpoints)

    listener.until(lambda: listener.blower.get_subscription_count() == 1)
    listener.setpoints.clear()
    assert listener.call("/clock/start").success
    listener.until(lambda: listener.setpoints)
    np.testing.assert_allclose(listener.setpoints[0].position, angles[-1])  # goes on from where it held
    listener.blower.publish(float64(0.4))
    listener.until(lambda: not any(listener.setpoints[-1].velocity))
    answer = listener.call("/clock/start")
    assert not answer.success
    assert "air is on (/bed/blower is 0.4)" in answer.message
