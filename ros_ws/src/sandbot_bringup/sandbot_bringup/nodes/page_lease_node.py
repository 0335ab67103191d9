"""The lease for what is started from a page: legs and air stop if the console dies or freezes, or that page is closed.

A person at a terminal commands without a lease (decision 16), as nobody can tell whether they are present. For a page
the console can. Pages that only watch keep nothing going: whoever started it may believe that it ends with their page.
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
PRESENT_S = 2.0
"""A page that has requested the state within this is open."""
SETTLE_S = 1.0
"""For this long after the response, clock and bed may still report their earlier state."""


class PageLease:
    """Renewed from the node's loop while something is ``under_way`` and every page that started it is open.

    It is not offered otherwise: whoever offers a lease commands, and all others would be refused.
    """

    def __init__(self, ros: Node, under_way: Callable[[], bool]) -> None:
        self._node, self._under_way = ros, under_way
        self._lock, self._asking = threading.Lock(), 0
        self._holders: dict[str, float] = {}  # when each page that started it was last seen
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

    def hold(self, page: str) -> None:
        """``page`` has started what is under way, or confirmed that it is to run; called within ``taken``."""
        with self._lock:
            self._holders[page] = time.monotonic()

    def seen(self, page: str) -> None:
        """``page`` is open; without a name it can't be told from others, and does not count."""
        with self._lock:
            if page and page in self._holders:
                self._holders[page] = time.monotonic()

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
        if self._needed(time.monotonic()):
            self._renew()
            return
        with self._lock:
            self._holders.clear()
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
            real_time_while(False, PRIORITY)

    def _needed(self, now_s: float) -> bool:
        with self._lock:
            held, open_s = bool(self._holders), min(self._holders.values(), default=math.inf)
        if now_s - open_s > PRESENT_S:
            return False
        begins = self._asking > 0 or now_s < self._until_s
        return begins or (self._publisher is not None and held and self._under_way())

    def _renew(self) -> None:
        if self._publisher is None:
            real_time_while(True, PRIORITY)
            self._publisher = endpoints.publisher(self._node, topics.OPERATOR_LEASE)
        self._publisher.publish(messages.header(self._node.get_clock().now().nanoseconds, self._node.get_name()))
