"""The nodes on this host as processes: whether they are alive, and how long they have waited for a CPU."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from sandbot_common.process import Neighbour

LOOK_S = 0.02
"""How often the operating system is queried."""


@dataclass
class Neighbours:
    """Nodes known to run on this host. ``faults``: by name, what happened to those that no longer run."""

    faults: Mapping[str, str] = field(default_factory=dict)
    _known: dict[str, Neighbour] = field(default_factory=dict)
    _names: dict[str, str] = field(default_factory=dict)
    _starved_s: dict[str, float] = field(default_factory=dict)
    _looked_s: float = -math.inf
    _asked: dict[str, tuple[Neighbour, float, str]] = field(default_factory=dict)

    def __contains__(self, who: str) -> bool:
        return who in self._known

    def meet(self, who: str, process: str) -> bool:
        """A node has named its process (``process.own_name``); one on another host is judged by its heartbeats alone.

        False if it is a second node of this name: it is about to be refused, so its diagnostics do not count.
        """
        known = self._known.get(who)
        if known is not None and not known.fault:
            return process in ("", self._names[who])
        if (neighbour := Neighbour.of(process)) is not None:
            self._known[who], self._names[who], self._starved_s[who] = neighbour, process, neighbour.starved_s
        return True

    def forget(self, who: str) -> None:
        """The node has ended as intended; the next one of that name is another process."""
        self._known.pop(who, None)
        self.faults = {name: fault for name, fault in self.faults.items() if name != who}

    def fault_of(self, who: str, now_s: float) -> str:
        """What happened to one node. Only this one is queried, as a clock checks at every step."""
        if (neighbour := self._known.get(who)) is None:
            return ""
        asked, asked_s, fault = self._asked.get(who, (None, -math.inf, ""))
        if asked is not neighbour or now_s - asked_s >= LOOK_S:
            fault = neighbour.fault
            self._asked[who] = neighbour, now_s, fault
        return fault

    def look(self, now_s: float) -> Mapping[str, float]:
        """Query the system if due; by name, how long each node has waited for a CPU since the last query [s]."""
        if now_s - self._looked_s < LOOK_S:
            return {}
        self._looked_s = now_s
        self.faults = {who: fault for who, neighbour in self._known.items() if (fault := neighbour.fault)}
        before, self._starved_s = self._starved_s, {who: known.starved_s for who, known in self._known.items()}
        return {who: max(total_s - before[who], 0.0) for who, total_s in self._starved_s.items()}
