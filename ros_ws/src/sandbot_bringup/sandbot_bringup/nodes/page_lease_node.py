"""The lease for what is started from the page: legs and air stop if the console dies or freezes, or no page is open.

A person at a terminal commands without a lease (decision 16), as nobody can tell whether they are present. For a page
the console can.
"""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher

from sandbot_common import messages, topics
from sandbot_common.process import real_time_while
from sandbot_common.ros import endpoints
from sandbot_common.ros.timer import Timer

PRIORITY = 2
"""Real-time priority meanwhile: if the console waits for a CPU longer than the lease, what it started ends."""
RENEW_S = 0.02
HEARD_S = 1.0
"""How long to wait until all obeying nodes have received the lease; it takes milliseconds unless one is frozen."""
SETTLE_S = 1.0
"""For this long after the response, clock and bed may still report their earlier state."""


class PageLease:
    """Renewed from the node's loop while ``needed``, that is while something started from the page is under way.

    It is not offered otherwise: whoever offers a lease commands, and all others would be refused.
    """

    def __init__(self, ros: Node, needed: Callable[[], bool]) -> None:
        self._node, self._needed = ros, needed
        self._lock, self._asking = threading.Lock(), 0
        self._until_s = -math.inf
        self._publisher: Publisher | None = None
        Timer(ros, RENEW_S, self._turn)

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Context in which a thread other than the loop's asks clock or bed to start something; takes the lease."""
        if self._publisher is None and self._node.count_publishers(topics.OPERATOR_LEASE.relative):
            yield  # a campaign commands, under its own lease
            return
        self._count(+1)
        try:
            self._await_hearers()
            yield
        finally:
            self._until_s = time.monotonic() + SETTLE_S
            self._count(-1)

    def _count(self, more: int) -> None:
        """Count the requests that await an answer: two pages may ask at once."""
        with self._lock:
            self._asking += more

    def _await_hearers(self) -> None:
        for _ in range(round(HEARD_S / RENEW_S)):
            time.sleep(RENEW_S)
            # Without a timeout: it holds the GIL, and nothing would be renewed meanwhile.
            if self._publisher is not None and self._publisher.wait_for_all_acked(Duration()):
                return

    def _turn(self) -> None:
        if self._asking or time.monotonic() < self._until_s or (self._publisher is not None and self._needed()):
            self._renew()
        elif self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
            real_time_while(False, PRIORITY)

    def _renew(self) -> None:
        if self._publisher is None:
            real_time_while(True, PRIORITY)
            self._publisher = endpoints.publisher(self._node, topics.OPERATOR_LEASE)
        self._publisher.publish(messages.header(self._node.get_clock().now().nanoseconds, self._node.get_name()))
