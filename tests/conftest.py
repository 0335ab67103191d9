import os
import signal
import time
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import settings

# A run started in the background inherits an ignored Ctrl-C, and so would every process whose stopping is tested.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes is the machine's affair: a deadline fails on a busy one.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture
def domain(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """A DDS domain of this test's own, set for its processes as well; above 101 its ports would be anybody's."""
    number = 1 + (os.getpid() * 7 + zlib.crc32(request.node.nodeid.encode())) % 100
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    return number


class Beside:
    """A ROS node beside those under test: it awaits events and calls services."""

    def __init__(self, domain: int) -> None:
        # Here and not above: most tests run without ROS.
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node("beside", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def wait(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Whether the condition came to hold in time."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
        return bool(condition())

    def until(self, condition: Callable[[], Any], seconds: float = 20.0) -> None:
        """Wait for the condition to hold."""
        assert self.wait(condition, seconds), "waited in vain"

    def call(self, service: str) -> Any:
        """The answer of a Trigger service."""
        from std_srvs.srv import Trigger

        from sandbot_common.node import ask

        client = self.node.create_client(Trigger, service)
        self.until(client.service_is_ready)
        answer = ask(client, Trigger.Request(), self.wait, 20.0)
        self.node.destroy_client(client)
        return answer

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def beside(domain: int) -> Iterator[Beside]:
    """A ROS node in this test's domain."""
    one = Beside(domain)
    yield one
    one.close()
