"""A serial line that is read in its own thread, and reopened when its cable is back."""

import errno
import math
import os
import select
import termios
import threading
import time
import traceback
from collections.abc import Callable

import serial

from sandbot_common.errors import InputError
from sandbot_hardware.lines import Line, Reader

RETRY_S = 0.5
LACK_S = 1.0
"""A line without a valid message for this long is an error, if bytes come, or if its device reports all the time."""
_WAIT_S = 0.1
"""The longest that a read or write waits: a device that accepts nothing must not hold up its driver."""


class Port:
    """``heard(line, received_ns)`` is called for every message, in the port's thread, with its arrival on the monotonic
    clock; ``log`` with a text at each change of ``trouble`` or ``lack``. ``steady``: whether the device reports all the
    time, so that silence, too, is an error.
    """

    def __init__(
        self,
        path: str,
        baud: int,
        heard: Callable[[Line, int], None],
        log: Callable[[str], object] = lambda _: None,
        *,
        steady: bool = False,
    ) -> None:
        self._path, self._baud, self._heard, self._log = path, baud, heard, log
        self._logged, self._steady = "", steady
        self._reader = Reader()
        self._device: serial.Serial | None = None
        self.trouble = f"{path}: not opened yet"
        """Why the line can't be used now; empty while it is open."""
        self.lack = ""
        """Why the device is not heard although the line is open; empty while it is."""
        self._lacking_since_s = math.inf
        self.opened = 0
        self._lock, self._closing = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=path, daemon=True)
        self._thread.start()

    @property
    def damaged(self) -> int:
        """Number of invalid messages."""
        return self._reader.damaged

    @property
    def health(self) -> tuple[int, str]:
        """Level and text for /diagnostics: a driver that has lost its device, or does not hear it, is an error."""
        why = self.trouble or self.lack
        return (2, why) if why else (0, "ok")

    def write(self, data: bytes) -> bool:
        """Send, and return whether it was sent; while the cable is out, nothing is kept for later."""
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
        """Finish writing, and close."""
        self._closing.set()
        self._thread.join()
        with self._lock:
            self._drop()

    def _run(self) -> None:
        try:
            self._read_until_closed()
        except Exception as error:  # of the driver; nothing else reports failures in this thread
            traceback.print_exception(error)
            with self._lock:
                self._drop()
                self.trouble = f"{self._path}: {type(error).__name__}: {error}; restart the driver"
            self._log(self.trouble)

    def _read_until_closed(self) -> None:
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
            received_ns = time.monotonic_ns()
            found = list(self._reader.feed(data))
            for line in found:
                self._hear(line, received_ns)
            self._judge(bool(data), bool(found), received_ns * 1e-9)

    def _judge(self, came: bool, valid: bool, now_s: float) -> None:
        """Judge what was just read, in this thread: what a busy machine reads late has come all the same."""
        heard = valid or self._reader.in_step if came else not self._steady
        self._lacking_since_s = math.inf if heard else min(self._lacking_since_s, now_s)
        lack = ""
        if now_s - self._lacking_since_s >= LACK_S:
            silent = f"no message for {LACK_S:g} s: is the device on?"
            noise = f"only noise for {LACK_S:g} s: wrong baud rate, or a bad cable?"
            lack = f"{self._path}: {silent if self._reader.in_step else noise}"
        if lack != self.lack:
            self.lack = lack
            self._log(lack or f"{self._path}: messages again")

    def _hear(self, line: Line, received_ns: int) -> None:
        try:
            self._heard(line, received_ns)
        except (ValueError, OverflowError):
            # A valid checksum but meaningless content, such as a time that is not a number: count it as damaged.
            self._reader.damaged += 1

    def _open(self) -> serial.Serial | None:
        try:
            # Two drivers on one line would take each other's bytes, and both would command.
            device = serial.Serial(self._path, self._baud, timeout=_WAIT_S, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            self._set_trouble(f"{self._path}: {_reason(error)}")
            return None
        with self._lock:
            self._device = device
            self._reader = Reader(self.damaged)  # what came before the cable was out is not continued
            self.lack, self._lacking_since_s = "", math.inf
            self.opened += 1
            self._set_trouble("")
        return device

    def _lose(self, error: Exception) -> None:
        self._drop()
        self._set_trouble(f"{self._path}: {_reason(error)}")

    def _drop(self) -> None:
        if self._device is not None:
            self._device.close()
            self._device = None

    def _set_trouble(self, trouble: str) -> None:
        self.trouble = trouble
        if trouble != self._logged:
            self._logged = trouble
            self._log(f"{trouble}; tried again every {RETRY_S:g} s" if trouble else f"{self._path}: open")


def send(file: int, data: bytes) -> None:
    """Write all of it. Raises TimeoutError if the device accepts nothing for ``_WAIT_S``.

    pyserial's write also fails if this process is held up after everything was sent: it would take a busy machine for
    an unplugged cable.
    """
    while data:
        _, ready, _ = select.select([], [file], [], _WAIT_S)
        if not ready:
            raise TimeoutError(None, f"took nothing for {_WAIT_S:g} s")
        data = data[os.write(file, data) :]


def fixed(_: object) -> None:
    """Refuse to change the parameters of a running driver."""
    raise InputError("the line is opened at the start: restart the driver to change it")


def _reason(error: Exception) -> str:
    if getattr(error, "errno", None) == errno.EAGAIN:
        return "another program has it open; one driver for each line"
    if isinstance(error, termios.error):  # not an OSError, and pyserial does not wrap it
        return str(error.args[-1])
    if number := getattr(error, "errno", None):
        return os.strerror(number)  # pyserial's own text repeats the path
    return getattr(error, "strerror", None) or "the cable is out"
