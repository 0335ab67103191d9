"""A pseudo-terminal in place of a serial device: its cable can be pulled, and its host may be slow to read."""

import os
import select
import threading
import tty
from collections import deque
from collections.abc import Callable
from pathlib import Path

from sandbot_hardware import lines

_QUEUED = 400
"""Messages that wait for a host that does not read, before the oldest are dropped."""


class Terminal:
    """One pseudo-terminal under a name; written to in its own thread, as a host may be slow to read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.reader = lines.Reader()
        self.master: int | None = None
        self._slave: int | None = None
        self._waiting: deque[Callable[[], bytes]] = deque(maxlen=_QUEUED)
        self._news = threading.Event()
        self.plug()
        threading.Thread(target=self._send, name=path.name, daemon=True).start()

    def plug(self) -> None:
        """Put the cable in."""
        if self.master is not None:
            return
        master, slave = os.openpty()
        tty.setraw(slave)
        # We keep the other end open, so that the terminal persists while no driver has it open.
        self._slave = slave
        new = self._path.with_suffix(".new")
        new.unlink(missing_ok=True)
        new.symlink_to(os.ttyname(slave))
        new.replace(self._path)
        self.master = master

    def pull(self) -> None:
        """Unplug the cable: a driver that has it open reads end of file."""
        if self.master is None:
            return
        self._path.unlink(missing_ok=True)
        master, self.master = self.master, None
        os.close(master)
        if self._slave is not None:
            os.close(self._slave)

    def say(self, make: Callable[[], bytes]) -> None:
        """Send soon; ``make`` builds the message in the terminal's own thread, and may be slow."""
        self._waiting.append(make)
        self._news.set()

    @property
    def idle(self) -> bool:
        """Whether everything has been sent."""
        return not self._waiting

    def _send(self) -> None:
        while self._news.wait():
            self._news.clear()
            while self._waiting:
                self._write(self._waiting.popleft()())

    def _write(self, message: bytes) -> None:
        data = memoryview(message)
        while data and (master := self.master) is not None:
            try:
                _, ready, _ = select.select([], [master], [], 0.1)
                data = data[os.write(master, data[:4096]) :] if ready else data
            except (OSError, ValueError):
                return  # pulled out meanwhile
