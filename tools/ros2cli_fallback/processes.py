"""Several processes as one: their output with a prefix each, stopped together. Output as the real launch prints it."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

GRACE_S = 5.0
"""After SIGINT, and once more after SIGTERM, before the next stronger signal."""

_STRONGER = {signal.SIGINT: signal.SIGTERM, signal.SIGTERM: signal.SIGKILL}


@dataclass
class Process:
    """What to start, and the running process with the thread that carries its output."""

    label: str
    command: Sequence[str]
    required: bool = True
    running: "subprocess.Popen[str] | None" = field(default=None, repr=False)
    carrier: threading.Thread | None = field(default=None, repr=False)


class Group:
    """Starts processes, waits for the first reason to stop, stops all."""

    def __init__(
        self, processes: Sequence[Process], say: Callable[[str], None] | None = None, grace_s: float = GRACE_S
    ) -> None:
        self._processes = processes
        self._lock = threading.Lock()
        self._say = say or (lambda line: print(line, flush=True))
        self._grace_s = grace_s
        # A plain flag, no Event: a signal handler that sets an Event in whose wait it came waits for itself for ever.
        self._stopping = False

    def interrupt(self) -> None:
        """Ask for the end (from a signal handler or another thread)."""
        self._stopping = True

    def run(self) -> int:
        """Start all, wait until asked to stop or a required process ends, stop all; 1 if a required one died."""
        alive: list[Process] = []
        code = 0
        try:
            for process in self._processes:
                self._start(process)
                alive.append(process)
            while alive and not self._stopping:
                for process in [one for one in alive if _ended(one)]:
                    alive.remove(process)
                    died = self._report(process)
                    if process.required:
                        code |= died
                        self._line(
                            "INFO", "launch", f"process[{process.label}] was required: shutting down launched system"
                        )
                        self._stopping = True
                time.sleep(0.05)
        finally:
            self._stop_all(alive)
        return code

    def _start(self, process: Process) -> None:
        # A session of its own: a terminal's Ctrl-C reaches this process alone, which then stops all in one way.
        running = subprocess.Popen(
            process.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            bufsize=1,
            start_new_session=True,
            # A node ends by itself where this process is killed and can't stop it (sandbot_common.ros.node).
            env={**os.environ, "TRACKWAY_END_WITH_PARENT": "1"},
        )
        process.running = running
        process.carrier = threading.Thread(target=self._carry, args=(process,), daemon=True)
        process.carrier.start()
        self._line("INFO", process.label, f"process started with pid [{running.pid}]")

    def _carry(self, process: Process) -> None:
        assert process.running is not None
        assert process.running.stdout is not None
        for line in process.running.stdout:
            self._print(f"[{process.label}] {line.rstrip()}")

    def _stop_all(self, alive: list[Process]) -> None:
        strength = signal.SIGINT
        while alive:
            for process in alive:
                if process.running is not None and process.running.poll() is None:
                    process.running.send_signal(strength)
            limit = time.monotonic() + self._grace_s
            while alive and time.monotonic() < limit:
                for process in [one for one in alive if _ended(one)]:
                    alive.remove(process)
                    self._report(process, asked=True)
                time.sleep(0.02)
            if alive and strength in _STRONGER:
                stronger = _STRONGER[strength]
                for process in alive:
                    self._line(
                        "ERROR",
                        process.label,
                        f"process[{process.label}] failed to terminate '{self._grace_s:g}' seconds after receiving "
                        f"'{strength.name}', escalating to '{stronger.name}'",
                    )
                strength = stronger

    def _report(self, process: Process, *, asked: bool = False) -> int:
        assert process.running is not None
        if process.carrier is not None:
            process.carrier.join(timeout=1.0)
        code, pid = process.running.returncode, process.running.pid
        if code == 0 or (asked and code in (-signal.SIGINT, 130)):
            self._line("INFO", process.label, f"process has finished cleanly [pid {pid}]")
            return 0
        command = " ".join(process.command)
        self._line("ERROR", process.label, f"process has died [pid {pid}, exit code {code}, cmd '{command}'].")
        return 1

    def _line(self, level: str, label: str, text: str) -> None:
        self._print(f"[{level}] [{label}]: {text}")

    def _print(self, line: str) -> None:
        with self._lock:
            try:
                self._say(line)
            except BrokenPipeError:
                # The reader (head, less) has gone; the processes must be stopped all the same.
                self._stopping = True
                self._say = lambda _: None


def _ended(process: Process) -> bool:
    return process.running is not None and process.running.poll() is not None


def run_until_signalled(group: Group) -> int:
    """Run the group until it ends or SIGINT, SIGTERM or SIGHUP arrives; 0 when asked to stop."""

    def on_signal(number: int, _: object) -> None:
        print(f"[WARNING] [launch]: user interrupted with ctrl-c ({signal.Signals(number).name})", file=sys.stderr)
        group.interrupt()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, on_signal)
    return group.run()
