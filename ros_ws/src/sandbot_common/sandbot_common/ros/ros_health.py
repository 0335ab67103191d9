"""A node's sign of life and key figures on /diagnostics, and one node of a name at a time."""

import math
import time
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from sandbot_common import messages, topics
from sandbot_common.health import PROCESS, ending
from sandbot_common.process import own_name
from sandbot_common.ros.endpoints import publisher, subscription
from sandbot_common.ros.timer import Timer
from sandbot_common.typed import number_or_nan

SETTLE_S = 0.5
"""This long after its first turn a node has heard any older one of its name: health is sent five times a second."""
_SINCE = "since_ns"


class Health:
    """Publishes a node's key figures on /diagnostics five times a second, which is also its sign of life.

    ``sole``: of several nodes of its name only the oldest stays (``refused`` tells the younger ones why they must end,
    and ``run`` ends them): a second clock or bed would command the same legs and the same air. Create it before the
    node's other publishers: one that publishes without it is not ours (``Rivals``).
    """

    def __init__(
        self, node: Node, values: Callable[[], Mapping[str, object]], period_s: float = 0.2, *, sole: bool = False
    ) -> None:
        self._node, self._values = node, values
        self.level, self.text = 0, "ok"
        self.refused = ""
        self.ended = ""
        """Why the node ends: reported in its last message instead of its level and text."""
        self._since_ns, self._process = time.time_ns(), own_name()
        self._turned_s = math.inf
        self._publisher = publisher(node, topics.DIAGNOSTICS)
        Timer(node, period_s, self.publish)
        node.health = self
        if sole:
            subscription(node, topics.DIAGNOSTICS, self._check_for_older)

    @property
    def settled(self) -> bool:
        """Whether it had time to find an older node of its name, and found none; a ``sole`` node is silent before."""
        return not self.refused and time.monotonic() - self._turned_s >= SETTLE_S

    def publish(self) -> None:
        """Publish now."""
        self._turned_s = min(self._turned_s, time.monotonic())
        self._publish(self._values())

    def announce_end(self, why: str) -> None:
        """Report that the node ends, without its figures: from any thread, even while the node's own is busy."""
        self.ended = why
        self._publish({})

    def _publish(self, figures: Mapping[str, object]) -> None:
        # Read after the figures are computed, as some nodes then set level and text.
        level, text = (2, ending(self.ended)) if self.ended else (self.level, self.text)
        values = {**figures, _SINCE: self._since_ns, PROCESS: self._process}
        now_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(messages.diagnostics(now_ns, self._node.get_name(), values, level=level, text=text))

    def _check_for_older(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = messages.values_of(status)
            if status.name == self._node.get_name() and self._is_older(values) and self._has_namesake():
                self.refused = f"another {status.name} is running already; one commander at a time, end it first"

    def _has_namesake(self) -> bool:
        """Whether another node of this name publishes; otherwise the message is from a bag that ``replay`` plays."""
        found = self._node.get_publishers_info_by_topic(topics.DIAGNOSTICS.relative)
        return sum(endpoint.node_name == self._node.get_name() for endpoint in found) > 1

    def _is_older(self, values: Mapping[str, str]) -> bool:
        """Whether the sender is older than this node. Processes are named by host, PID and start (``own_name``)."""
        ours, theirs = self._process.split(), values.get(PROCESS, "").split()
        if len(ours) == len(theirs) == 3 and ours[0] == theirs[0] and ours[2] != theirs[2]:
            # Same host: start times count from its boot, so setting the system clock does not change them.
            return number_or_nan(theirs[2]) < int(ours[2])
        # Both as floats, to whose precision a node is not older than itself.
        return number_or_nan(values.get(_SINCE)) < float(self._since_ns)
