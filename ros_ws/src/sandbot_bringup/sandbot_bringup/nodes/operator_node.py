"""The operator's interface to a running campaign: stop, pause, go; skip, repeat, add. Commands are answered and logged.

stop, pause and go are services (``hold_node``). The others come as JSON on campaign/command: ``{"id":
"...", "do": "skip", "trial_id": "..."}``, ``repeat`` likewise, or ``{"do": "add", "phi": 0.605, "omega_rad_s": 12,
"replicates": 2, "gait": "UNIFORM"}``; campaign/status answers by ``id``.
"""

import copy
import json
import math
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String

from sandbot_bringup.journal import Journal
from sandbot_bringup.nodes.hold_node import HoldServices
from sandbot_bringup.plan import Plan
from sandbot_bringup.queue import Queue
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.files import parse_json
from sandbot_common.ros.endpoints import publisher, subscription
from sandbot_common.ros.timer import Timer

STATUS_S = 1.0
_ANSWERS, _TAIL = 20, 60
"""Answers and events kept in the status."""


class OperatorInterface:
    """Publishes campaign/status at every change and once a second; ``keep_plan`` stores an extended plan.

    ``look`` is the result of the last look of a campaign until a verdict.
    """

    def __init__(
        self,
        node: Node,
        folder: Path,
        queue: Queue,
        services: HoldServices,
        journal: Journal,
        keep_plan: Callable[[Plan], None],
    ) -> None:
        self.queue, self.hold = queue, services.hold
        self._node, self._folder, self._journal, self._keep_plan = node, folder, journal, keep_plan
        self._stage = self._ended = ""
        self.look: Mapping[str, Any] | None = None
        self._answers: dict[str, dict[str, Any]] = {}
        self._status = publisher(node, topics.CAMPAIGN_STATUS)
        subscription(node, topics.CAMPAIGN_COMMAND, self._on_command)
        services.changed = self._on_hold
        Timer(node, STATUS_S, self.say)
        self.say()

    @property
    def attended(self) -> bool:
        """Whether a console runs, from which an operator could say go."""
        return bool(self._node.count_publishers(topics.CAMPAIGN_COMMAND.relative))

    def note(self, do: str, *, who: str = "campaign", **what: object) -> None:
        """Log an event in the journal, and publish the status."""
        self._journal.add(who, do, **what)
        self.say()

    def enter(self, stage: str) -> None:
        """Set the stage of the trial under way; empty if there is none."""
        self._stage, self._ended = stage, ""
        self.say()

    def end(self, reason: str) -> None:
        """Nothing more is run, for ``reason``, unless a stage is entered again (--redo)."""
        self._stage, self._ended = "", reason
        with suppress(OSError, InputError):  # e.g. a full disk
            self._journal.add("campaign", "end", reason=reason)
        self.say()

    def say(self) -> None:
        """Publish the status in ASCII, the only encoding for a lone surrogate that JSON input may contain."""
        self._status.publish(messages.string(json.dumps(self._content(), allow_nan=False)))

    def _content(self) -> Mapping[str, Any]:
        left_s = self.queue.left_s()
        return {
            "campaign": self.queue.plan.name,
            "folder": str(self._folder),
            "gait": self.queue.plan.gait_name,
            "state": "ended" if self._ended else self.hold.state,
            "why": self._ended or self.hold.why,
            "stage": self._stage,
            "left_s": round(left_s, 1) if math.isfinite(left_s) else None,
            "queue": self.queue.rows(),
            "look": self.look,
            "free_bytes": self._free_bytes(),
            "answers": self._answers,
            "events": self._journal.events[-_TAIL:],
        }

    def _free_bytes(self) -> int | None:
        """Free space on the campaign's disk; None if it is not accessible, e.g. unplugged."""
        try:
            return shutil.disk_usage(self._folder).free
        except OSError:
            return None

    def _on_hold(self, do: str) -> None:
        self.note(do, who="operator", **({"reason": self.hold.why} if self.hold.why else {}))

    def _on_command(self, message: String) -> None:
        asked: Any = None
        try:
            asked = parse_json(message.data, topics.CAMPAIGN_COMMAND.name)
            answer = {"success": True, "message": self._obey(asked)}
        except InputError as error:
            answer = {"success": False, "message": str(error)}
        if isinstance(asked, Mapping):
            self._answers[str(asked.get("id", ""))] = answer
            self._answers = dict(list(self._answers.items())[-_ANSWERS:])
        self.say()

    def _obey(self, asked: Any) -> str:
        if not isinstance(asked, Mapping):
            raise InputError(f"campaign/command: a mapping with the key do is needed, got {asked!r}")
        what = {key: value for key, value in asked.items() if key not in ("id", "do")}
        queue = copy.deepcopy(self.queue)
        match asked.get("do"):
            case "skip" | "repeat" as do if list(what) == ["trial_id"]:
                said = getattr(queue, do)(str(what["trial_id"]))
            case "add" as do:
                said = queue.add(what)
            case other:
                raise InputError(
                    f"campaign/command: {other!r} with {sorted(what)} is not a command: skip or repeat with trial_id, "
                    "or add with phi, omega_rad_s, replicates and gait"
                )
        # If writing fails the order is refused, and nothing has changed, not even what a resumed campaign would run.
        self._journal.add("operator", do, **what, followed=said)
        if queue.plan != self.queue.plan:
            self._keep_plan(queue.plan)
        self.queue.take(queue)
        return str(said)
