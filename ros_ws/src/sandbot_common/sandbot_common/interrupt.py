"""Ctrl-C where it can end a command cleanly.

Python raises KeyboardInterrupt between any two steps of the main thread. Raised within a lock of the standard library,
it leaves the lock locked, and another thread waits for it for ever; within an import or a call of numba's it is lost,
comes out as another error, or crashes; emcee prints a traceback of it. There it is held back until the call has ended.
"""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

PATIENCE_S = {
    **dict.fromkeys(("threading", "queue", "concurrent", "multiprocessing"), 0.5),
    **dict.fromkeys(("importlib", "numba", "llvmlite", "ctypes", "weakref", "_weakrefset", "emcee"), 10.0),
}
"""How long an interrupt is held back within a call of these packages. A lock is taken for microseconds, so who is there
for longer waits, and must be interrupted."""
RETRY_S = 0.01


@contextmanager
def ctrl_c_where_safe(*, last: bool = False) -> Iterator[None]:
    """KeyboardInterrupt is raised once, outside the packages of ``PATIENCE_S``; what is cleaned up after it is not
    interrupted again, nor, if this is the ``last`` a process does, is its exit.

    No effect outside the main thread, or where Ctrl-C is handled otherwise.
    """
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    interrupt = _Interrupt()
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        held = interrupt.let_go()
        if not (last and interrupt.asked):
            signal.signal(signal.SIGINT, signal.default_int_handler)
        if held:
            raise KeyboardInterrupt


class _Interrupt:
    """Raises KeyboardInterrupt for a signal, or is called again a moment later by an alarm."""

    def __init__(self) -> None:
        self._asked_s: float | None = None
        self._alarm_before: Any = None
        """The handler that the alarm replaces while an interrupt is held back."""

    @property
    def asked(self) -> bool:
        """Whether Ctrl-C was typed."""
        return self._asked_s is not None

    def __call__(self, _number: int, frame: FrameType | None) -> None:
        now_s = time.monotonic()
        if self._asked_s is None:
            self._asked_s = now_s
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        if now_s - self._asked_s < max((PATIENCE_S.get(package, 0.0) for package in _packages(frame)), default=0.0):
            if self._alarm_before is None:
                self._alarm_before = signal.signal(signal.SIGALRM, self)
            signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        else:
            self.let_go()
            raise KeyboardInterrupt

    def let_go(self) -> bool:
        """Give the alarm back. Returns whether an interrupt was held back."""
        held = self._alarm_before is not None
        if held:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, self._alarm_before)
            self._alarm_before = None
        return held


def _packages(frame: FrameType | None) -> Iterator[str]:
    """The packages whose functions are being called, the innermost first."""
    while frame is not None:
        yield str(frame.f_globals.get("__name__", "")).split(".")[0]
        frame = frame.f_back
