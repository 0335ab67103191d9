"""Ending a process in order when a signal asks for it."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from sandbot_common.health import ending


class Stop:
    """Whether the process is to end, and why."""

    def __init__(self) -> None:
        self.why = ""

    @property
    def asked(self) -> bool:
        """Whether anybody asked."""
        return bool(self.why)

    def ask(self, why: str) -> None:
        """Request the end. A plain attribute, not an Event: a signal handler must not wait for a lock of its thread."""
        self.why = self.why or why

    def say(self, name: str) -> None:
        """Print one line about the reason, unless the terminal has been closed."""
        if self.why:
            with suppress(OSError):
                print(f"{name}: {ending(self.why)}", file=sys.stderr, flush=True)


@contextmanager
def stop_signals() -> Iterator[Stop]:
    """Ctrl-C, kill and a closed terminal request an orderly end; no effect outside the main thread.

    Afterwards a process that was asked ignores Ctrl-C: typed again, it would end the exit with another code.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {each: signal.signal(each, lambda number, _: stop.ask(signal.Signals(number).name)) for each in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if stop.asked and number == signal.SIGINT else handler)
