"""stop, pause and go of a campaign as services (std_srvs/Trigger), so that anything can call them.

They are offered as soon as the node exists: a campaign that is stopped while it still looks for its nodes is held.
"""

import time
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.node import Node
from std_srvs.srv import Trigger

from sandbot_bringup.hold import Hold
from sandbot_common.ros.timer import watched

T = TypeVar("T")


class HoldServices:
    """``changed`` is called with each order that changed the hold; a repeated order changes nothing."""

    def __init__(self, node: Node, hold: Hold) -> None:
        self.hold = hold
        self.changed: Callable[[str], None] = lambda _: None
        self._standstill = watched(node)
        for name, answer in (("stop", self._stop), ("pause", self._pause), ("go", self._go)):
            node.create_service(Trigger, f"campaign/{name}", _trigger(answer))

    def _stop(self) -> tuple[bool, str]:
        self._standstill.stop(time.monotonic())
        return True, self._apply("hold", lambda: self.hold.stop("stopped by the operator"))

    def _pause(self) -> tuple[bool, str]:
        return True, self._apply("pause", self.hold.pause)

    def _go(self) -> tuple[bool, str]:
        if refusal := self._standstill.refusal(time.monotonic()):
            return False, refusal
        return self._apply("go", self.hold.go)

    def _apply(self, do: str, change: Callable[[], T]) -> T:
        before = self.hold.state
        answer = change()
        if self.hold.state != before:
            self.changed(do)
        return answer


def _trigger(answer: Callable[[], tuple[bool, str]]) -> Callable[[Any, Any], Any]:
    def on_request(_: Any, response: Any) -> Any:
        response.success, response.message = answer()
        return response

    return on_request
