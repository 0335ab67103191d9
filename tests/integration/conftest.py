import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml


class Process:
    """A real process whose output lines can be awaited; its stdin is a terminal at which keys can be struck."""

    def __init__(self, command: list[str], env: dict[str, str]) -> None:
        self.lines: list[str] = []
        self._news = threading.Condition()
        keyboard, terminal = pty.openpty()
        self._keyboard, self._terminal = os.fdopen(keyboard, "w"), os.fdopen(terminal)
        self._process = subprocess.Popen(
            command, env=env, text=True, stdin=self._terminal, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            start_new_session=True,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The process's own number; it leads a group of its own."""
        return self._process.pid

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._news:
                self.lines.append(line.rstrip("\n"))
                self._news.notify_all()
        with self._news:
            self._news.notify_all()

    def until(self, matches: Callable[[str], bool], timeout_s: float = 60.0) -> str:
        """The first line that matches; fails with the whole output where the process ends or time is up."""
        deadline = time.monotonic() + timeout_s
        with self._news:
            while True:
                for line in self.lines:
                    if matches(line):
                        return line
                left = deadline - time.monotonic()
                if left <= 0 or (self._process.poll() is not None and not self._reader.is_alive()):
                    raise AssertionError("no such line in:\n" + "\n".join(self.lines))
                self._news.wait(left)

    def strike(self, keys: str, timeout_s: float = 60.0) -> None:
        """Keys, once the process takes them one by one."""
        deadline = time.monotonic() + timeout_s
        while termios.tcgetattr(self._terminal)[3] & termios.ICANON:
            assert time.monotonic() < deadline, "it does not listen to keys:\n" + "\n".join(self.lines)
            time.sleep(0.02)
        self.type(keys)

    def type(self, text: str) -> None:
        """Text at its standard input."""
        self._keyboard.write(text)
        self._keyboard.flush()

    @property
    def ended(self) -> bool:
        """Whether it has."""
        return self._process.poll() is not None

    def wait(self, timeout_s: float) -> int:
        """The exit code."""
        return self._process.wait(timeout_s)

    def stop(self) -> int:
        """Ctrl-C to the whole group, then the exit code."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGINT)
            try:
                self._process.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(self._process.pid, signal.SIGKILL)
        self._reader.join(5)
        assert self._process.stdout is not None
        for file in (self._process.stdout, self._keyboard, self._terminal):
            file.close()
        return self._process.wait(5)


QUICK_BED = {"fluidise_s": 0.7, "ramp_s": 0.3, "settle_s": 0.4, "pulse_off_s": 0.3, "average_s": 0.2}
"""A bed prepared in seconds; the real one takes a quarter of a minute and more."""


@pytest.fixture
def quick_bed() -> list[str]:
    """The bed of ``plan_of_one`` as arguments of ``ros2 launch``; leases no busy machine loses."""
    clock = {"clock.lease_s": 1.0, "clock.robot_s": 1.0, "clock.late_s": 0.25}
    patient = clock | {"lab.legs_lease_s": 1.0, "lab.air_lease_s": 2.0, "bed.lease_s": 2.0, "bed.bad_reading_s": 2.0}
    return [f"{name}:={value}" for name, value in ({f"bed.{k}": v for k, v in QUICK_BED.items()} | patient).items()]


@pytest.fixture
def finished(start: Callable[..., Process]) -> Callable[..., None]:
    """Wait for a live campaign to end well: a trial that a busy machine spoilt is marked, and run again."""

    def wait(campaign: Process, *again: object) -> None:
        for _ in range(3):
            if campaign.wait(200) == 0:
                return
            campaign = start(*again[:4], "--redo", "failed", *again[4:])  # not behind --ros-args
        assert campaign.wait(200) == 0, "\n".join(campaign.lines)

    return wait


@pytest.fixture
def plan_of_one(tmp_path: Path) -> Callable[..., Path]:
    """Write a plan of one trial, or as changed, on the quick bed."""

    def write(**changed: object) -> Path:
        plan = {"name": "one", "seed": 5, "gait": "UNIFORM", "phi": [0.605], "omega_rad_s": [12.0], "replicates": 1}
        path = tmp_path / "one.yaml"
        path.write_text(yaml.safe_dump(plan | {"bed": QUICK_BED} | changed))
        return path

    return write


@pytest.fixture
def nodes_of_a_trial(start: Callable[..., Process]) -> None:
    """The nodes of a trial in the virtual lab, each in a process of its own."""
    for package, node in (("clock", "clock"), ("bed", "bed"), ("lab", "lab"), ("tracking", "tracker")):
        module = f"sandbot_{package}.nodes.{node}_node"
        start(sys.executable, "-c", f"from {module} import main; raise SystemExit(main())")


@pytest.fixture
def ros_env(domain: int) -> dict[str, str]:
    """An environment on a DDS domain of this test's own, on this host only."""
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONUNBUFFERED": "1",
    }


@pytest.fixture
def start(ros_env: dict[str, str]) -> Iterator[Callable[..., Process]]:
    """Start processes that are stopped when the test ends."""
    running: list[Process] = []

    def run(*command: str | Path) -> Process:
        running.append(Process([str(one) for one in command], ros_env))
        return running[-1]

    yield run
    for process in reversed(running):
        process.stop()
