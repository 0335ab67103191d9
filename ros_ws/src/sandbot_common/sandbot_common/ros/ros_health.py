"""A node's sign of life and key figures on /diagnostics, and one node of a name at a time."""

import math
import os
import time
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from sandbot_common import messages, topics
from sandbot_common.health import PROCESS, TIMELESS, ending
from sandbot_common.process import Neighbour, own_name
from sandbot_common.ros.endpoints import publisher, subscription
from sandbot_common.ros.timer import Timer
from sandbot_common.standstill import Standstill
from sandbot_common.typed import number_or_nan

SETTLE_TURNS = 4
"""After so many turns of its loop a node has handled what any older one of its name said meanwhile, twice at least:
health is sent at each, five times a second. Time alone would not tell, as a busy machine may hold up the loop."""
_SINCE, _WOKE = "since_ns", "woke"
_CLOCK = "/clock"
"""Where ROS looks for simulated time."""
_BOOT = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""Counts while the machine is suspended, too."""


class Health:
    """Publishes a node's key figures on /diagnostics five times a second, which is also its sign of life.

    ``sole``: of several nodes of its name only the oldest stays (``refused`` tells the younger ones why they must end,
    and ``run`` ends them): a second clock or bed would command the same legs and the same air. A process that stood
    still is as old as its waking: another may have taken over, as it was dead to everybody. Create it before the node's
    other publishers: one that publishes without it is not ours (``Rivals``).
    """

    def __init__(self, node: Node, values: Callable[[], Mapping[str, object]], *, sole: bool = False) -> None:
        self._node, self._values = node, values
        self.level, self.text = 0, "ok"
        self.refused = ""
        self.ended = ""
        """Why the node ends: reported in its last message instead of its level and text."""
        self._since_ns, self._process = time.time_ns(), own_name()
        self._turns, self._awake = 0, Standstill()
        self._publisher = publisher(node, topics.DIAGNOSTICS)
        Timer(node, 0.2, self._beat, self._turn)
        node.health = self
        if sole:
            subscription(node, topics.DIAGNOSTICS, self._check_for_older)

    @property
    def settled(self) -> bool:
        """Whether it had time to find an older node of its name, and found none; a ``sole`` node is silent before."""
        return not self.refused and self._turns >= SETTLE_TURNS

    @property
    def held_up_s(self) -> float:
        """How long the process stood still until just now [s]; 0 if it did not."""
        self._turn()
        return self._awake.held_s if self._awake.refusal(_since_boot_s()) else 0.0

    def publish(self) -> None:
        """Publish now."""
        self._publish(self._values())

    def announce_end(self, why: str) -> None:
        """Report that the node ends, without its figures: from any thread, even while the node's own is busy."""
        self.ended = why
        self._publish({})

    def _beat(self) -> None:
        self._turns += 1
        self.publish()

    def _turn(self) -> None:
        if self._awake.turn(_since_boot_s()):
            self._since_ns = time.time_ns()

    @property
    def _woke(self) -> float:
        """When the process resumed, in clock ticks since boot, as its start; minus infinity if it never did."""
        return self._awake.woke_s * os.sysconf("SC_CLK_TCK")

    def _publish(self, figures: Mapping[str, object]) -> None:
        self._turn()
        # Read after the figures are computed, as some nodes then set level and text.
        level, text = (2, ending(self.ended)) if self.ended else (self.level, self.text)
        values = {**figures, _SINCE: self._since_ns, PROCESS: self._process}
        if why := _timeless(self._node):
            values[TIMELESS] = why
            level, text = (level, text) if level else (1, why)
        if math.isfinite(self._woke):
            values[_WOKE] = round(self._woke)
        now_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(messages.diagnostics(now_ns, self._node.get_name(), values, level=level, text=text))

    def _check_for_older(self, message: DiagnosticArray) -> None:
        self._turn()
        name = self._node.get_name()
        for status in message.status:
            values = messages.values_of(status)
            if status.name == name and self._is_older(values) and self._has_namesake(values.get(PROCESS, "")):
                taken = f"held up for {self._awake.held_s:.2g} s, and another {name} has taken over meanwhile"
                there = taken if self._awake.held_s else f"another {name} is running already"
                self.refused = f"{there}; one commander at a time, end it first"

    def _has_namesake(self, process: str) -> bool:
        """Whether another node of this name publishes; otherwise the message is from a bag that ``replay`` plays.

        One whose ``process`` is gone from this host is not counted, though DDS may still know it.
        """
        if self._on_same_host(process) and Neighbour.of(process) is None:
            return False
        found = self._node.get_publishers_info_by_topic(topics.DIAGNOSTICS.relative)
        return sum(endpoint.node_name == self._node.get_name() for endpoint in found) > 1

    def _on_same_host(self, process: str) -> bool:
        """Processes are named by host, PID and start (``own_name``)."""
        ours, theirs = self._process.split(), process.split()
        return len(ours) == len(theirs) == 3 and ours[0] == theirs[0]

    def _is_older(self, values: Mapping[str, str]) -> bool:
        """Whether the sender is older than this node."""
        process = values.get(PROCESS, "")
        if self._on_same_host(process) and (theirs := process.split()[2]) != (ours := self._process.split()[2]):
            # Same host: start times count from its boot, so setting the system clock does not change them.
            return max(number_or_nan(theirs), number_or_nan(values.get(_WOKE))) < max(int(ours), self._woke)
        # Both as floats, to whose precision a node is not older than itself.
        return number_or_nan(values.get(_SINCE)) < float(self._since_ns)


def _timeless(node: Node) -> str:
    """Why a node's stamps show no time; an empty string if they show one."""
    waits = node.get_parameter("use_sim_time").value and not node.count_publishers(_CLOCK)
    return f"use_sim_time is set, but nobody publishes {_CLOCK}: stamps show 1970" if waits else ""


def _since_boot_s() -> float:
    return time.clock_gettime(_BOOT)
