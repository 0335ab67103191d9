import fcntl
import itertools
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# A run started in the background inherits an ignored Ctrl-C, and so would every process whose stopping is tested.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes is the machine's affair: a deadline fails on a busy one.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


DOMAINS = range(1, 102)
"""Above 101 a DDS domain's ports would be anybody's; 0 is whatever else runs on this host."""


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A DDS domain that no other test on this host has, set for this test's processes as well."""
    folder = Path(tempfile.gettempdir()) / f"trackway-domains-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    # Not all from the first on: what a domain was left with may need a moment to go.
    for number in itertools.islice(itertools.cycle(DOMAINS), os.getpid() % len(DOMAINS), None):
        with (folder / str(number)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the end of this process frees it, whatever happens
            except BlockingIOError:
                continue
            monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
            yield number
            return


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

    def until(self, condition: Callable[[], Any], seconds: float = 60.0) -> None:
        """Wait for the condition to hold; the limit is there to fail, not to measure."""
        assert self.wait(condition, seconds), "waited in vain"

    def call(self, service: str) -> Any:
        """The answer of a Trigger service."""
        from std_srvs.srv import Trigger

        from sandbot_common.node import ask

        client = self.node.create_client(Trigger, service)
        self.until(client.service_is_ready)
        answer = ask(client, Trigger.Request(), self.wait, 60.0)
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
