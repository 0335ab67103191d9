"""Who may command legs and air, as the obeying nodes see it: the commander's lease, and whether its process runs."""

import math
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from sandbot_common import messages, topics
from sandbot_common.health import PROCESS
from sandbot_common.lease import Lease
from sandbot_common.neighbours import LOOK_S, Neighbours
from sandbot_common.ros.endpoints import NAMELESS, names_of, subscription

LEGS, AIR, NOTHING = "legs", "air", "nothing"
"""What a lease lets begin, after the name in its frame_id, e.g. "campaign legs"; anything, if it does not say."""


PASSING_S = 0.1
"""For less than this one of our nodes, as it comes or goes, publishes without reporting its health: their publishers
are created and destroyed one after the other, health first and last."""


class Partners:
    """Other nodes of this host as processes: one that is gone or frozen is detected before its lease runs out.

    A node on another host is noticed only by its silence.
    """

    def __init__(self, node: Node) -> None:
        self._neighbours, self._lock = Neighbours(), threading.Lock()
        subscription(node, topics.DIAGNOSTICS, self._on_diagnostics)

    def begin(self, name: str) -> None:
        """``name`` commands from now on: forget an earlier process of that name that has ended."""
        if self.fault(name):
            with self._lock:
                self._neighbours.forget(name)

    def fault(self, name: str) -> str:
        """What happened to it, e.g. "the clock is gone"; an empty string while it runs or nothing is known of it."""
        # Checked here and not by a timer, which in a busy node would queue behind all pending messages.
        with self._lock:
            fault = self._neighbours.fault_of(name, time.monotonic())
        return f"the {name} {fault}" if fault else ""

    def lost(self, name: str, lease: Lease, silence: str) -> str:
        """Why to stop obeying it: its process has failed, or ``silence`` for too long; empty while it commands."""
        if fault := self.fault(name):
            return fault
        return f"{silence} for {lease.limit_s:g} s" if lease.late(time.monotonic()) else ""

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            with self._lock:
                self._neighbours.meet(status.name, messages.values_of(status).get(PROCESS, ""))


class Rivals:
    """Detects several nodes that publish one topic. Messages do not name their sender, so publishers are counted.

    Of several of one name, those that report their health are ours: killed ones, which DDS forgets after 20 s, and ones
    about to be refused (``Health``). Any other is a rival.
    """

    def __init__(self, node: Node, *sole: topics.Topic) -> None:
        self._node, self._sole = node, sole
        self._looked_s, self._fault = -math.inf, ""
        self._seen_s: dict[str, dict[tuple[bytes, str], float]] = {}

    def fault(self) -> str:
        """E.g. "a and b both publish /leg_setpoints"; an empty string while each topic has at most one publisher."""
        now_s = time.monotonic()
        if now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            self._fault = next(filter(None, map(self._look, self._sole)), "")
        return self._fault

    def _look(self, topic: topics.Topic) -> str:
        if self._node.count_publishers(topic.relative) < 2:  # ten times cheaper than getting their names
            return ""
        found = self._publishing(topic)
        names = sorted({name for _, name in found})
        if len(names) > 1:
            return f"{' and '.join(names)} both publish {topic.name}"
        if len(found) < 2:
            return ""
        strangers, seen_s = found - self._publishing(topics.DIAGNOSTICS), self._seen_s.get(topic.name, {})
        self._seen_s[topic.name] = {one: seen_s.get(one, self._looked_s) for one in strangers}
        if all(self._looked_s - since_s < PASSING_S for since_s in self._seen_s[topic.name].values()):
            return ""
        return f"two nodes named {names[0]} publish {topic.name}"

    def _publishing(self, topic: topics.Topic) -> set[tuple[bytes, str]]:
        """Process and name of each node that publishes: the GUID's first 12 bytes are the process (RTPS 2.3, 9.3.1)."""
        found = self._node.get_publishers_info_by_topic(topic.relative)
        return {(bytes(one.endpoint_gid[:12]), one.node_name) for one in found if one.node_name != NAMELESS}


class Command:
    """The commander's lease as the obeying nodes see it: checked before motion or air begins and at each step.

    If nobody publishes /operator/lease, a person commands by hand, and there is nothing to renew. The lease belongs to
    whoever renewed it when motion or air began: nobody else can keep them going. As a request does not name its sender,
    the lease says what may begin (``LEGS``, ``AIR``, ``NOTHING``).
    """

    def __init__(self, node: Node, limit_s: float, what: str) -> None:
        """``what``: LEGS or AIR, which begins here."""
        self._node, self._lease, self._partners = node, Lease(limit_s), Partners(node)
        self._leased, self._what = False, what
        self._holder = self._heard_from = "somebody"
        self._allowed = ""
        self._heard_s = -math.inf
        subscription(node, topics.OPERATOR_LEASE, self._on_renewal)

    def begin(self, limit_s: float) -> str:
        """Why nothing may begin; an empty string if it may, from now on under this lease or by hand."""
        self._holder, self._lease = self._heard_from, Lease(limit_s, self._heard_s)
        holders = names_of(self._node.get_publishers_info_by_topic(topics.OPERATOR_LEASE.relative))
        self._leased = bool(holders)
        # DDS forgets a killed publisher after 20 s, and its name earlier; the operating system knows at once.
        living = [name for name in holders if name != NAMELESS and not self._partners.fault(name)]
        self._partners.begin(self._holder)
        if len(living) > 1:
            return f"{' and '.join(living)} both command the trackway (/operator/lease); one at a time"
        if self._leased and self._lease.late(time.monotonic()):
            who = next((name for name in holders if name != NAMELESS), "somebody")
            return f"{who} commands the trackway and does not renew /operator/lease; end it first"
        if self._leased and self._allowed not in ("", self._what):
            return f"{self._holder} commands the trackway and lets {self._allowed} begin; end it first"
        return ""

    def lost(self) -> str:
        """Why to stop; an empty string while the lease is renewed or a person commands."""
        if not self._leased:
            return ""
        return self._partners.lost(self._holder, self._lease, f"{self._holder} did not renew /operator/lease")

    def _on_renewal(self, message: Any) -> None:
        name, _, self._allowed = message.frame_id.partition(" ")
        self._heard_from, self._heard_s = name or "somebody", time.monotonic()
        if self._heard_from == self._holder:
            self._lease.renew(self._heard_s)
