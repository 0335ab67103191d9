"""A serial line that is read in a thread of its own, and opened again when its cable is back."""

import errno
import os
import select
import termios
import threading
import time
from collections.abc import Callable

import serial

from sandbot_common.errors import InputError
from sandbot_hardware.lines import Line, Reader

RETRY_S = 0.5
_WAIT_S = 0.1
"""A read waits so long at most, and so does a write: a device that takes nothing must not hold up its driver."""


class Port:
    """``heard(line, received_ns)`` is called for every message, in the port's thread."""

    def __init__(self, path: str, baud: int, heard: Callable[[Line, int], None]) -> None:
        self._path, self._baud, self._heard = path, baud, heard
        self._reader = Reader()
        self._device: serial.Serial | None = None
        self.trouble = f"{path}: not opened yet"
        """Why nothing can be said or heard now; empty while the line is there."""
        self.opened = 0
        self._lock, self._closing = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=path, daemon=True)
        self._thread.start()

    @property
    def damaged(self) -> int:
        """Messages that did not check."""
        return self._reader.damaged

    @property
    def health(self) -> tuple[int, str]:
        """Level and text for /diagnostics: without its device a driver is no use."""
        return (2, self.trouble) if self.trouble else (0, "ok")

    def write(self, data: bytes) -> bool:
        """Whether it was sent; where the cable is out, nothing is kept for later."""
        with self._lock:
            if self._device is None:
                return False
            try:
                send(self._device.fileno(), data)
            except OSError as error:  # serial's own errors are OSErrors
                self._lose(error)
                return False
            return True

    def close(self) -> None:
        """Let what was written go out, and close."""
        self._closing.set()
        self._thread.join()
        with self._lock:
            if self._device is not None:
                self._device.close()
                self._device = None

    def _run(self) -> None:
        while not self._closing.is_set():
            device = self._device or self._open()
            if device is None:
                self._closing.wait(RETRY_S)
                continue
            try:
                data = device.read(max(1, device.in_waiting))
            except (OSError, termios.error, TypeError) as error:  # TypeError: closed by a write that failed meanwhile
                with self._lock:
                    self._lose(error)
                continue
            received_ns = time.time_ns()
            for line in self._reader.feed(data):
                self._hear(line, received_ns)

    def _hear(self, line: Line, received_ns: int) -> None:
        try:
            self._heard(line, received_ns)
        except (ValueError, OverflowError):
            # It checks and means nothing, a time that is no number say: as good as damaged, and the next one comes.
            self._reader.damaged += 1

    def _open(self) -> serial.Serial | None:
        try:
            # Of two drivers on one line each would take the other's bytes, and both would command.
            device = serial.Serial(self._path, self._baud, timeout=_WAIT_S, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            self.trouble = f"{self._path}: {_said(error)}"
            return None
        with self._lock:
            self._device, self.trouble = device, ""
            self.opened += 1
        return device

    def _lose(self, error: Exception) -> None:
        if self._device is not None:
            self._device.close()
            self._device = None
        self.trouble = f"{self._path}: {_said(error)}"


def send(file: int, data: bytes) -> None:
    """Write all of it. Raises TimeoutError where the device takes nothing for ``_WAIT_S``.

    Not pyserial's write: that also fails where this process was held up for longer, after all had gone out, and a busy
    machine was taken for a cable that is out.
    """
    while data:
        _, ready, _ = select.select([], [file], [], _WAIT_S)
        if not ready:
            raise TimeoutError(None, f"took nothing for {_WAIT_S:g} s")
        data = data[os.write(file, data) :]


def fixed(_: object) -> None:
    """Refuse to change the parameters of a driver that runs."""
    raise InputError("the line is opened at the start: restart the driver to change it")


def _said(error: Exception) -> str:
    if getattr(error, "errno", None) == errno.EAGAIN:
        return "another program has it open; one driver for each line"
    if isinstance(error, termios.error):  # no OSError, and pyserial lets it through
        return str(error.args[-1])
    return getattr(error, "strerror", None) or "the cable is out"
