"""Timers on the monotonic clock, independent of ROS time."""

import threading
import time
from collections.abc import Callable

from rclpy.node import Node

from sandbot_common.standstill import Standstill

TURN_S = 0.1


class Timer:
    """Calls back in the node's loop by elapsed time: for commands, watchdogs and signs of life.

    ROS's own timers follow the system clock, or /clock: if it is set back by a minute they stop for a minute, and with
    them the watchdog that turns the air off. A steady ROS clock does not help, as the wheels' executor waits for all
    its timers by the system clock (decision 16). So a Python thread waits.
    """

    def __init__(
        self, node: Node, period_s: float, callback: Callable[[], object], alive: Callable[[], object] = lambda: None
    ) -> None:
        """``alive`` is called from the thread as often, however busy the loop is; a frozen process calls neither."""
        self._alive = alive
        self._node, self._period_s, self._callback = node, period_s, callback
        self._due, self._ending = False, threading.Event()
        self._thread = threading.Thread(target=self._run, name="timer", daemon=True)
        node.waiting = [*getattr(node, "waiting", ()), self]
        self._thread.start()

    def cancel(self) -> None:
        """Call no more."""
        self._ending.set()

    def end(self) -> None:
        """Cancel and join the thread, which must not use the node once it is destroyed."""
        self.cancel()
        self._thread.join()

    def _run(self) -> None:
        due_s = time.monotonic() + self._period_s
        while self._node.context.ok() and not self._ending.wait(max(due_s - time.monotonic(), 0.0)):
            self._alive()
            # A call still pending in a busy loop is not queued again, and missed calls are not made up for.
            if not self._due and (executor := self._node.executor) is not None:
                self._due = True
                executor.create_task(self._call)
            due_s = max(due_s + self._period_s, time.monotonic())

    def _call(self) -> None:
        self._due = False
        if not self._ending.is_set() and not _called(self._node, self._callback):
            self._ending.set()


def call_soon(node: Node, callback: Callable[[], None]) -> None:
    """Have the node's loop call back, after everything already pending."""
    if (executor := node.executor) is not None:
        executor.create_task(_called, node, callback)


def _called(node: Node, callback: Callable[[], object]) -> bool:
    """Call back; False if that raises."""
    try:
        callback()
    except Exception as error:
        # The executor of these wheels does not survive a task that raises; ``spin_once`` re-raises in the node's loop.
        node.failed = error
        return False
    return True


def watched(node: Node) -> Standstill:
    """A ``Standstill`` updated by the node's loop: requests received while the loop stands still start nothing."""
    found = Standstill()
    Timer(node, TURN_S, lambda: found.turn(time.monotonic()))
    return found


def end_timers(node: Node) -> None:
    """End all timers of a node; call before it is destroyed or its context shut down."""
    for timer in getattr(node, "waiting", ()):
        timer.end()
