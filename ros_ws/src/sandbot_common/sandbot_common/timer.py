"""What calls a node back as time passes, whatever ROS takes the time to be."""

import threading
import time
from collections.abc import Callable

from rclpy.node import Node

from sandbot_common.standstill import Standstill

TURN_S = 0.1


class Timer:
    """Calls back in the node's loop, by the time that has passed: for what commands, watches or tells that it lives.

    ROS's own timers go by the system clock, or by /clock: where that is set back by a minute they stand still for one,
    and with them the watchdog that turns the air off. Nor does a steady clock of ROS's help, for the wheels' executor
    waits for its timers by the system clock whatever theirs is (decision 16). So a thread waits, as Python does it.
    """

    def __init__(self, node: Node, period_s: float, callback: Callable[[], None]) -> None:
        self._node, self._period_s, self._callback = node, period_s, callback
        self._due, self._ending = False, threading.Event()
        self._thread = threading.Thread(target=self._run, name="timer", daemon=True)
        node.waiting = [*getattr(node, "waiting", ()), self]
        self._thread.start()

    def cancel(self) -> None:
        """Call no more."""
        self._ending.set()

    def end(self) -> None:
        """The same, and no thread of it is left: it would ask a node that has been destroyed."""
        self.cancel()
        self._thread.join()

    def _run(self) -> None:
        due_s = time.monotonic() + self._period_s
        while self._node.context.ok() and not self._ending.wait(max(due_s - time.monotonic(), 0.0)):
            # A loop that is busy is not asked again, nor is what it missed caught up.
            if not self._due and (executor := self._node.executor) is not None:
                self._due = True
                executor.create_task(self._call)
            due_s = max(due_s + self._period_s, time.monotonic())

    def _call(self) -> None:
        self._due = False
        if not self._ending.is_set() and not _called(self._node, self._callback):
            self._ending.set()


def call_soon(node: Node, callback: Callable[[], None]) -> None:
    """Have the node's loop call back, behind what has come for it by now."""
    if (executor := node.executor) is not None:
        executor.create_task(_called, node, callback)


def _called(node: Node, callback: Callable[[], None]) -> bool:
    """Call back; False where that raises."""
    try:
        callback()
    except Exception as error:
        # The executor of these wheels dies of a task that raises; ``spin_once`` has the node's loop raise it.
        node.failed = error
        return False
    return True


def watched(node: Node) -> Standstill:
    """One that turns with the node's loop: whatever is asked while the loop stands still starts nothing."""
    found = Standstill()
    Timer(node, TURN_S, lambda: found.turn(time.monotonic()))
    return found


def end_timers(node: Node) -> None:
    """Before the node is destroyed, or its context shut down."""
    for timer in getattr(node, "waiting", ()):
        timer.end()
