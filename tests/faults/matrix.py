"""Faults × moments of a live trial, as a table: `make faults`, or this file with --targets, --faults, --moments.

Every cell is a trial of its own with real nodes: at the moment named, the process named is killed, frozen or ended. The
table tells the seconds until legs were at rest and air was off, as robot and bed say where they live, and what is left.
"""

import argparse
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from conftest import Beside, own_domain
from sandbot_common import messages, node, topics
from sandbot_common.errors import InputError
from sandbot_record.bags.reader import Bag

BED = {"fluidise_s": 1.5, "ramp_s": 0.3, "settle_s": 0.4, "pulse_off_s": 0.3, "average_s": 0.2}
PLAN = {"name": "one", "seed": 5, "gait": "UNIFORM", "phi": [0.605], "omega_rad_s": [8.0], "replicates": 1,
        "periods": 6.0, "standing_s": 1.0, "bed": BED}  # fmt: skip
NODES = {
    "clock": "sandbot_clock.clock_node",
    "bed": "sandbot_bed.bed_node",
    "lab": "sandbot_lab.lab_node",
    "tracker": "sandbot_tracking.tracker_node",
}
TARGETS = (*NODES, "recorder", "campaign")
SIGNALS = {"KILL": signal.SIGKILL, "TERM": signal.SIGTERM, "HUP": signal.SIGHUP, "INT": signal.SIGINT}
FROZEN_S = {"STOP": None, "STOP 0.3": 0.3, "STOP 3": 3.0}
FAULTS = (*SIGNALS, *FROZEN_S)
MOMENTS = ("blowing", "standing", "walking", "stopping")
MARK = "TRACKWAY_FAULTS"
"""Environment variable by which a cell knows its processes again."""


class Witness:
    """What the robot and the bed say, with the time of each change; of a robot that dies, what it is told."""

    def __init__(self, beside: Beside, *, robot_dies: bool) -> None:
        self.beside, self.moving, self.air, self.prepared = beside, False, False, False
        self.rest_ns = self.off_ns = 0
        self.moved_s = self.blown_s = 0.0
        # The legs of a dead robot are its driver's affair; the commands still have to end.
        node.subscription(beside.node, topics.LEG_SETPOINTS if robot_dies else topics.LEG_STATES, self._on_legs)
        node.subscription(beside.node, topics.BED_BLOWER, lambda message: self._on_air(message.data > 0))
        node.subscription(beside.node, topics.BED_PHI, self._on_phi)
        node.subscription(beside.node, topics.DIAGNOSTICS, self._on_diagnostics)

    def _on_phi(self, _: Any) -> None:
        self.prepared = True

    def _on_legs(self, message: Any) -> None:
        moving = any(message.velocity)
        if moving and not self.moving:
            self.moved_s = time.monotonic()
        if self.moving and not moving:
            # The robot's own time: how late this reaches us is not its affair.
            self.rest_ns = messages.nanoseconds(message.header.stamp)
        self.moving = moving

    def _on_air(self, on: bool) -> None:
        if on and not self.air:
            self.blown_s = time.monotonic()
        if self.air and not on:
            self.off_ns = time.time_ns()
        self.air = on

    def _on_diagnostics(self, message: Any) -> None:
        # A bed that was killed says nothing any more; the one who blows does.
        if any(status.name == "lab" and status.message.startswith("air off") for status in message.status):
            self._on_air(False)

    def all_up(self) -> bool:
        """Whether all nodes are there."""
        needed = (topics.LEG_SETPOINTS, topics.BED_BLOWER, topics.LEG_STATES, topics.COM)
        return all(self.beside.node.count_publishers(topic.name) for topic in needed)

    def at(self, moment: str) -> Callable[[], bool]:
        return {
            # Not at the first word of it: one bed was frozen while it told us, before the lab had heard.
            "blowing": lambda: self.air and time.monotonic() - self.blown_s > 0.2,
            "standing": lambda: self.prepared and not self.air,
            "stopping": lambda: self.moved_s > 0 and not self.moving,
            "walking": lambda: self.moving and time.monotonic() - self.moved_s > 0.5,
        }[moment]


@contextmanager
def started(
    folder: Path, silence_s: float, all_up: Callable[[], object]
) -> Iterator[tuple[dict[str, subprocess.Popen[str]], str]]:
    """Nodes and, when these are up, the campaign, by name, and the mark they all carry; ended whatever happens."""
    mark = uuid.uuid4().hex
    env = {**os.environ, MARK: mark, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    (folder / "one.yaml").write_text(yaml.safe_dump(PLAN))
    bed = [word for name, value in BED.items() for word in ("-p", f"{name}:={value}")]
    commands = {
        name: [*run_main(module), "--ros-args", *(bed if name == "bed" else [])] for name, module in NODES.items()
    }
    plan = [str(folder / "one.yaml"), "--out", str(folder / "out"), "--silence", str(silence_s)]
    commands["campaign"] = [*run_main("sandbot_bringup.tools.campaign"), *plan]
    running = {}
    for name, command in commands.items():
        if name == "campaign":
            all_up()
        log = (folder / f"{name}.log").open("w")
        running[name] = subprocess.Popen(
            [sys.executable, *command], env=env, stdout=log, stderr=log, text=True, start_new_session=True
        )
        log.close()
    try:
        yield running, mark
    finally:
        for pid in marked(mark):
            os.kill(pid, signal.SIGKILL)
        for process in running.values():
            process.wait()


def run_main(module: str) -> list[str]:
    """Arguments of Python that run a module's ``main``."""
    return ["-c", f"import sys; from {module} import main; sys.exit(main(sys.argv[1:]))"]


def marked(mark: str) -> list[int]:
    """The processes that carry a mark."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"{MARK}={mark}".encode() in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
        except OSError:
            continue
    return found


def pid_of(target: str, running: dict[str, subprocess.Popen[str]], mark: str) -> int:
    if target != "recorder":
        return running[target].pid
    return next(
        pid for pid in marked(mark) if b"sandbot_record.tools.record" in Path(f"/proc/{pid}/cmdline").read_bytes()
    )


def strike(pid: int, fault: str, beside: Beside) -> None:
    """Do to the process what the fault says; a frozen one may go on later."""
    if fault in SIGNALS:
        os.kill(pid, SIGNALS[fault])
        return
    os.kill(pid, signal.SIGSTOP)
    if (frozen_s := FROZEN_S[fault]) is not None:
        beside.wait(lambda: False, frozen_s)
        os.kill(pid, signal.SIGCONT)


def cell(target: str, fault: str, moment: str, silence_s: float = 1.0) -> list[str]:
    """One row of the table; ``silence_s``: of the campaign."""
    with tempfile.TemporaryDirectory() as name, own_domain(os.getpid()) as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        folder, beside = Path(name), Beside(domain)
        try:
            witness = Witness(beside, robot_dies=target == "lab")
            with started(folder, silence_s, lambda: beside.wait(witness.all_up, 90.0)) as (running, mark):
                return [target, fault, moment, *outcome(target, fault, moment, folder, running, mark, witness)]
        finally:
            beside.close()


def outcome(
    target: str, fault: str, moment: str, folder: Path, running: Any, mark: str, witness: Witness
) -> Sequence[str]:
    """Strike at the moment, and tell what came of it."""
    beside = witness.beside
    campaign, come = running["campaign"], witness.at(moment)
    if not beside.wait(lambda: come() or campaign.poll() is not None, 90.0) or not come():
        return ["-", "-", "-", "-", f"the moment never came: {last_line(folder / 'campaign.log')}", "-"]
    was_moving, was_blowing = witness.moving, witness.air
    pid, start_ns = pid_of(target, running, mark), time.time_ns()
    witness.rest_ns = witness.off_ns = 0
    strike(pid, fault, beside)
    beside.wait(lambda: not witness.moving and not witness.air, 10.0)
    frozen = target == "campaign" and fault == "STOP"
    beside.wait(lambda: campaign.poll() is not None or frozen, 90.0)
    beside.wait(lambda: not recorders(mark) or frozen, 10.0)
    left = "recorder" if recorders(mark) and not frozen else "nothing"
    bag, status = bag_of(folder / "out")
    rest = told(was_moving, witness.moving, witness.rest_ns, start_ns)
    off = told(was_blowing, witness.air, witness.off_ns, start_ns)
    code = campaign.poll()
    what = "frozen" if code is None else f"exit {code}: {last_line(folder / 'campaign.log')}"
    return [rest, off, bag, status, what, left]


def recorders(mark: str) -> list[int]:
    command = b"sandbot_record.tools.record"
    return [pid for pid in marked(mark) if command in (Path(f"/proc/{pid}/cmdline").read_bytes())]


def told(was_on: bool, is_on: bool, end_ns: int, start_ns: int) -> str:
    if not was_on:
        return "-"
    return "NEVER" if is_on else f"{(end_ns - start_ns) * 1e-9:.2f}"


def bag_of(out: Path) -> tuple[str, str]:
    """Whether the bag can be read, and how it says the trial ended."""
    bags = [path for path in [*out.glob("trials/phi*"), *out.glob("trials/.partial/phi*")] if path.is_dir()]
    if not bags:
        return "none", "-"
    try:
        return "whole", Bag.open(bags[-1]).provenance.get("trial", {}).get("exit_status", "?")
    except InputError:
        return "torn, for recover", "?"


def last_line(log: Path) -> str:
    lines = [line for line in log.read_text(errors="replace").replace("\r", "\n").splitlines() if "%|" not in line]
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", nargs="+", choices=TARGETS, default=TARGETS)
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=FAULTS)
    parser.add_argument("--moments", nargs="+", choices=MOMENTS, default=MOMENTS)
    chosen = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # not without ending what was started
    head = (
        "who",
        "fault",
        "moment",
        "legs at rest [s]",
        "air off [s]",
        "bag",
        "exit_status",
        "campaign",
        "left running",
    )
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    for target, fault, moment in itertools.product(chosen.targets, chosen.faults, chosen.moments):
        print("| " + " | ".join(cell(target, fault, moment)) + " |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
