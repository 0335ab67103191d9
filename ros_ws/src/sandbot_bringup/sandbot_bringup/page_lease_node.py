"""The lease of what is started from the page: legs and air stop when the console dies, freezes, or no page looks on.

A person at a terminal commands without a lease (decision 16), for nobody can tell whether he is there. Of a page the
console can.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher

from sandbot_common import messages, node, topics
from sandbot_common.process import real_time_while
from sandbot_common.timer import Timer

PRIORITY = 2
"""Real-time priority meanwhile: a console that waits for a CPU for as long as the lease ends what it started."""
RENEW_S = 0.02
HEARD_S = 1.0
"""How long it is waited for that all who obey have heard of the lease; milliseconds, where none is frozen."""
ANSWER_S = 10.0
"""Longer than any call takes."""
SETTLE_S = 1.0
"""So long after the answer, clock and bed may still tell how it was before."""


class PageLease:
    """Renewed from the node's loop for as long as ``goes_on`` says that what was started does, and somebody looks on.

    It is not offered otherwise: whoever offers a lease commands, and all others would be refused.
    """

    def __init__(self, ros: Node, goes_on: Callable[[], bool]) -> None:
        self._node, self._goes_on = ros, goes_on
        self._until_s = -math.inf
        self._publisher: Publisher | None = None
        Timer(ros, RENEW_S, self._turn)

    @contextmanager
    def taken(self) -> Iterator[None]:
        """While clock or bed are asked to start something, by another thread than the loop's, and from then on."""
        if self._publisher is None and self._node.count_publishers(topics.OPERATOR_LEASE.relative):
            yield  # a campaign commands: its word decides
            return
        self._until_s = time.monotonic() + ANSWER_S
        try:
            self._await_hearers()
            yield
        finally:
            self._until_s = time.monotonic() + SETTLE_S

    def _await_hearers(self) -> None:
        for _ in range(round(HEARD_S / RENEW_S)):
            time.sleep(RENEW_S)
            # Not for longer at a time: it keeps Python's lock, and nothing would be renewed meanwhile.
            if self._publisher is not None and self._publisher.wait_for_all_acked(Duration()):
                return

    def _turn(self) -> None:
        if time.monotonic() < self._until_s or (self._publisher is not None and self._goes_on()):
            self._renew()
        elif self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
            real_time_while(False, PRIORITY)

    def _renew(self) -> None:
        if self._publisher is None:
            real_time_while(True, PRIORITY)
            self._publisher = node.publisher(self._node, topics.OPERATOR_LEASE)
        self._publisher.publish(messages.header(self._node.get_clock().now().nanoseconds, self._node.get_name()))
