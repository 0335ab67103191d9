"""Faults × moments of a live trial, as a table: `make faults`, or this file with --targets, --faults, --moments.

Every cell is a trial of its own with real nodes: at the moment named, the process named is killed, frozen or ended. The
table tells the seconds until legs were at rest and air was off, as robot and bed say where they live, and what is left.
"""

import argparse
import contextlib
import fcntl
import itertools
import json
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import tempfile
import termios
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
import cells

from conftest import Beside, own_domain
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.process import real_time
from sandbot_common.ros import endpoints
from sandbot_record.bags.reader import Bag

BED = {"fluidise_s": 1.5, "ramp_s": 0.3, "settle_s": 0.4, "pulse_off_s": 0.3, "average_s": 0.2}
PLAN = {"name": "one", "seed": 5, "gait": "UNIFORM", "phi": [0.605], "omega_rad_s": [8.0], "replicates": 1,
        "periods": 6.0, "standing_s": 1.0, "bed": BED}  # fmt: skip
NODES = {
    "clock": "sandbot_clock.nodes.clock_node",
    "bed": "sandbot_bed.nodes.bed_node",
    "lab": "sandbot_lab.nodes.lab_node",
    "tracker": "sandbot_tracking.nodes.tracker_node",
}
TARGETS = (*NODES, "recorder", "campaign", "launch")
SIGNALS = {"KILL": signal.SIGKILL, "TERM": signal.SIGTERM, "HUP": signal.SIGHUP, "INT": signal.SIGINT}
FROZEN_S = {"STOP": None, "STOP 0.3": 0.3, "STOP 3": 3.0}
CTRL_C, CLOSED, FULL, SECOND = "Ctrl-C", "closed terminal", "full disk", "a second one"
ONLY_FOR = {CTRL_C: ("campaign", "launch"), CLOSED: ("campaign", "launch"), FULL: ("recorder",)}
ONLY_FOR[SECOND] = ("campaign", "launch")
"""Whom these faults can meet; the others meet everybody."""
FAULTS = (*SIGNALS, *FROZEN_S, *ONLY_FOR)
MOMENTS = ("preparing", "blowing", "standing", "walking", "stopping", "closing")
PRIORITY = 1
"""Of the witness, below all nodes that have any: one without it was 10 s behind, and said that legs never stopped."""
MARK = "TRACKWAY_FAULTS"
"""Environment variable by which a cell knows its processes again."""


class Witness:
    """What the robot and the bed say, with the time of each change; of a robot that dies, what it is told."""

    def __init__(self, beside: Beside, *, robot_dies: bool) -> None:
        self.beside, self.moving, self.air, self.stage = beside, False, False, ""
        self.rest_ns = self.off_ns = 0
        self.moved_s = self.blown_s = 0.0
        # The legs of a dead robot are its driver's affair; the commands still have to end.
        endpoints.subscription(beside.node, topics.LEG_SETPOINTS if robot_dies else topics.LEG_STATES, self._on_legs)
        endpoints.subscription(beside.node, topics.BED_BLOWER, self._on_blower)
        endpoints.subscription(beside.node, topics.CAMPAIGN_STATUS, self._on_campaign)
        endpoints.subscription(beside.node, topics.DIAGNOSTICS, self._on_diagnostics)

    def _on_campaign(self, message: Any) -> None:
        self.stage = json.loads(message.data)["stage"]

    def _on_legs(self, message: Any) -> None:
        moving = any(message.velocity)
        if moving and not self.moving:
            self.moved_s = time.monotonic()
        if self.moving and not moving:
            # The robot's own time: how late this reaches us is not its affair.
            self.rest_ns = messages.nanoseconds(message.header.stamp)
        self.moving = moving

    def _on_blower(self, message: Any, info: Mapping[str, int]) -> None:
        self._on_air(message.data > 0, info["source_timestamp"])

    def _on_air(self, on: bool, at_ns: int) -> None:
        """As with the legs: when it was said, however late it reaches us."""
        if on and not self.air:
            self.blown_s = time.monotonic()
        if self.air and not on:
            self.off_ns = at_ns
        self.air = on

    def _on_diagnostics(self, message: Any) -> None:
        # A bed that was killed says nothing any more; the one who blows does.
        if any(status.name == "lab" and status.message.startswith("air off") for status in message.status):
            self._on_air(False, messages.nanoseconds(message.header.stamp))

    def all_up(self) -> bool:
        """Whether all nodes are there."""
        needed = (topics.LEG_SETPOINTS, topics.BED_BLOWER, topics.LEG_STATES, topics.COM)
        return all(self.beside.node.count_publishers(topic.name) for topic in needed)

    def at(self, moment: str) -> Callable[[], bool]:
        return {
            "preparing": lambda: self.stage == "preparing the bed" and not self.air,
            # Not at the first word of it: one bed was frozen while it told us, before the lab had heard.
            "blowing": lambda: self.air and time.monotonic() - self.blown_s > 0.2,
            "standing": lambda: self.stage == "standing",
            "stopping": lambda: self.moved_s > 0 and not self.moving,
            "closing": lambda: self.stage == "closing the bag",
            "walking": lambda: self.moving and time.monotonic() - self.moved_s > 0.5,
        }[moment]


class Cell:
    """The processes of a cell, each at a terminal of its own, known by a mark that all they start carry, too."""

    def __init__(self, folder: Path, trials: int) -> None:
        self.folder, self.mark = folder, uuid.uuid4().hex
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self._terminals: dict[str, int] = {}
        (folder / "one.yaml").write_text(yaml.safe_dump(PLAN | {"replicates": trials}))

    def start(self, name: str, command: Sequence[str]) -> None:
        """Start a process whose words go to ``name``.log."""
        self._terminals[name], terminal = pty.openpty()
        env = {**os.environ, MARK: self.mark, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "PYTHONUNBUFFERED": "1"}
        with (self.folder / f"{name}.log").open("w") as log:
            self.running[name] = subprocess.Popen(
                command, env=env, stdin=terminal, stdout=log, stderr=log, start_new_session=True,
                preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # Ctrl-C and a hang-up reach it
            )  # fmt: skip
        os.close(terminal)

    def start_nodes(self, *, launched: bool) -> None:
        """The nodes of a trial, by the launch file or one by one."""
        if launched:
            self.start("launch", launch_command())
            return
        for name, module in NODES.items():
            bed = [word for key, value in BED.items() for word in ("-p", f"{key}:={value}")] if name == "bed" else []
            self.start(name, [*run_main(module), "--ros-args", *bed])

    def start_campaign(self, name: str, silence_s: float) -> None:
        """A campaign into the folder ``name``."""
        plan = [str(self.folder / "one.yaml"), "--out", str(self.folder / name), "--silence", str(silence_s)]
        self.start(name, [*run_main("sandbot_bringup.tools.campaign"), *plan])

    def at_terminal(self, name: str, fault: str) -> None:
        """Strike Ctrl-C there, or close it."""
        if fault == CTRL_C:
            os.write(self._terminals[name], b"\x03")
        else:
            os.close(self._terminals.pop(name))

    def marked(self, word: str = "") -> list[int]:
        """The living processes of this cell whose command has that word."""
        found = []
        for path in Path("/proc").glob("[0-9]*"):
            try:
                ours = f"{MARK}={self.mark}".encode() in (path / "environ").read_bytes().split(b"\0")
                if ours and word.encode() in (path / "cmdline").read_bytes():
                    found.append(int(path.name))
            except OSError:
                continue
        return found

    def last_line(self, name: str) -> str:
        """What a process said last, but for a campaign's list of what failed, each of which it told before."""
        text = (self.folder / f"{name}.log").read_text(errors="replace").replace("\r", "\n")
        lines = [line.strip() for line in text.splitlines() if "%|" not in line and not line.startswith("failed: ")]
        return next((line.replace(f"{self.folder}/", "") for line in reversed(lines) if line), "")

    def tracebacks(self) -> list[str]:
        """Whose last words were not one line."""
        logs = sorted(self.folder.glob("*.log"))
        return [f"{log.stem}'s traceback" for log in logs if "Traceback" in log.read_text(errors="replace")]

    def close(self) -> None:
        """End all of them, whatever happened."""
        for pid in self.marked():
            os.kill(pid, signal.SIGKILL)
        for process in self.running.values():
            process.wait()
        for terminal in self._terminals.values():
            os.close(terminal)


def run_main(module: str) -> list[str]:
    """The command that runs a module's ``main``."""
    return [sys.executable, "-c", f"import sys; from {module} import main; sys.exit(main(sys.argv[1:]))"]


def launch_command() -> list[str]:
    return ["ros2", "launch", "sandbot_bringup", "trackway.launch.py", *(f"bed.{k}:={v}" for k, v in BED.items())]


SHARED_MEMORY = Path("/dev/shm")
BORN_S = 10.0
"""A segment so young may not have been mapped yet."""
RECORDER = "sandbot_record.tools.record"


def strike(cell: Cell, target: str, fault: str, beside: Beside) -> int:
    """Do to the process what the fault says, a frozen one may go on later; when [ns].

    The time is taken last: on a busy machine it takes a second to find out which process the recorder is.
    """
    pid = cell.running[target].pid if target != "recorder" else cell.marked(RECORDER)[0]
    start_ns = time.time_ns()
    if fault == SECOND and target == "launch":
        cell.start("second", launch_command())
    elif fault == SECOND:
        cell.start_campaign("second", 1.0)
    elif fault in (CTRL_C, CLOSED):
        cell.at_terminal(target, fault)
    elif fault == FULL:
        # Not a byte more into any file, from now on.
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, 0))
    elif fault in SIGNALS:
        os.kill(pid, SIGNALS[fault])
    else:
        os.kill(pid, signal.SIGSTOP)
        if (frozen_s := FROZEN_S[fault]) is not None:
            beside.wait(lambda: False, frozen_s)
            os.kill(pid, signal.SIGCONT)
    return start_ns


def row(target: str, fault: str, moment: str, silence_s: float, trials: int) -> list[str]:
    """One row of the table; ``silence_s`` and ``trials``: of the campaign."""
    with tempfile.TemporaryDirectory() as name, own_domain(os.getpid()) as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        cell = Cell(Path(name), trials)
        with real_time(PRIORITY, inherited=True):
            beside = Beside(domain)
        try:
            witness = Witness(beside, robot_dies=target in ("lab", "launch"))
            cell.start_nodes(launched=target == "launch")
            beside.wait(witness.all_up, 90.0)
            cell.start_campaign("campaign", silence_s)
            with real_time(PRIORITY):
                return [target, fault, moment, *outcome(cell, target, fault, moment, witness)]
        finally:
            cell.close()
            beside.close()
            clear_memory()


def clear_memory() -> None:
    """Remove what killed nodes have left, 70 MB each: after 300 cells a machine of 24 GB had no memory any more.

    Segments that no process maps. Ports stay: one that is just being opened is lost to a node, which then is deaf.
    """
    mapped: set[str] = set()
    for path in Path("/proc").glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):
            mapped.update(re.findall(r"/fastrtps_([0-9a-f]{16})$", path.read_text(), re.M))
    for segment in SHARED_MEMORY.glob("fastrtps_" + "[0-9a-f]" * 16):
        if segment.name.removeprefix("fastrtps_") not in mapped and time.time() - segment.stat().st_mtime > BORN_S:
            segment.unlink(missing_ok=True)
            segment.with_name(f"{segment.name}_el").unlink(missing_ok=True)


def outcome(cell: Cell, target: str, fault: str, moment: str, witness: Witness) -> Sequence[str]:
    """Strike at the moment, and tell what came of it."""
    beside, campaign, come = witness.beside, cell.running["campaign"], witness.at(moment)
    if not beside.wait(lambda: come() or campaign.poll() is not None, 90.0) or not come():
        return ["-", "-", "-", "-", f"{cells.NEVER_CAME}: {cell.last_line('campaign')}", "-", "-"]
    was_moving, was_blowing, load = witness.moving, witness.air, os.getloadavg()[0]
    witness.rest_ns = witness.off_ns = 0
    start_ns = strike(cell, target, fault, beside)
    frozen = target == "campaign" and fault == "STOP"
    # A launch that is frozen keeps nobody from his work.
    goes_on = fault == SECOND or (target == "launch" and fault in FROZEN_S)
    if not goes_on:
        beside.wait(lambda: not witness.moving and not witness.air, 10.0)
    rest = told(was_moving, witness.moving, witness.rest_ns, start_ns)
    off = told(was_blowing, witness.air, witness.off_ns, start_ns)
    if goes_on:
        rest = off = "goes on"
    beside.wait(lambda: campaign.poll() is not None or frozen, 120.0)
    beside.wait(lambda: frozen or not leftovers(cell, target, fault), 10.0)
    left = [*([] if frozen else leftovers(cell, target, fault)), *cell.tracebacks()]
    bag, status = bag_of(cell.folder / "campaign")
    code = campaign.poll()
    what = "frozen" if code is None else f"exit {code}: {cell.last_line('campaign')}"
    if fault == SECOND:
        what += f"; the second, exit {cell.running['second'].poll()}: {cell.last_line('second')}"
    return [rest, off, bag, status, what, ", ".join(left) or "nothing", f"{load:.0f}"]


def leftovers(cell: Cell, target: str, fault: str) -> list[str]:
    """What should have ended by now: the recorder always, of a launch that was ended its nodes."""
    left = ["recorder"] * len(cell.marked(RECORDER))
    if target == "launch" and fault not in (SECOND, "STOP", *FROZEN_S):
        left += [f"{len(cell.marked('ros2')) + len(cell.marked('_node'))} processes"] * bool(cell.marked())
    return left


def told(was_on: bool, is_on: bool, end_ns: int, start_ns: int) -> str:
    if not was_on or 0 < end_ns < start_ns:  # it had stopped before, and we had not heard
        return "-"
    return "NEVER" if is_on else f"{(end_ns - start_ns) * 1e-9:.2f}"


def bag_of(out: Path) -> tuple[str, str]:
    """Whether the first trial's bag can be read, and how it says the trial ended."""
    bags = [path for path in [*out.glob("trials/.partial/phi*"), *out.glob("trials/phi*")] if path.is_dir()]
    if not bags:
        return "none", "-"
    try:
        return "whole", Bag.open(bags[0]).provenance.get("trial", {}).get("exit_status", "?")
    except InputError:
        return "torn, for recover", "?"


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", nargs="+", choices=TARGETS, default=TARGETS)
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=FAULTS)
    parser.add_argument("--moments", nargs="+", choices=MOMENTS, default=MOMENTS)
    parser.add_argument("--trials", type=int, default=1, help="of each campaign: what it does next is seen with 2")
    parser.add_argument("--silence", type=float, default=1.0, metavar="S", help="of each campaign")
    parser.add_argument("--out", type=Path, help="JSON lines: what stands there is not run again")
    parser.add_argument("--part", default="1/1", metavar="I/N", help="the I-th of N parts: several streams, one file")
    chosen = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # not without ending what was started
    wanted = [
        cell
        for cell in itertools.product(chosen.targets, chosen.faults, chosen.moments)
        if cell[0] in ONLY_FOR.get(cell[1], TARGETS)
    ]
    part, parts = map(int, chosen.part.split("/"))
    todo = cells.missing(wanted[part - 1 :: parts], chosen.out) if chosen.out else wanted[part - 1 :: parts]
    for target, fault, moment in todo:
        one = row(target, fault, moment, chosen.silence, chosen.trials)
        print(cells.line(one), flush=True)
        if chosen.out:
            cells.add(chosen.out, one)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
