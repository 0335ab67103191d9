"""doctor: what works here, what does not, and what to do about it. Nothing is changed."""

import argparse
import fcntl
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import distributions
from pathlib import Path

from ros2cli_fallback.main import real_ros2
from sandbot_common import cli
from sandbot_common.shared_memory import NEEDED_BYTES, SHARED_MEMORY
from sandbot_common.terminal import styled
from trackway_command.version import version

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S, LONGEST_S = 20.0, 3600.0
"""For two processes to start and find each other on a busy machine."""
GIB, MIB = 1 << 30, 1 << 20
LITTLE, LEAST = 5 * GIB, 0.2 * GIB
"""Disk space: a live campaign with frames takes gigabytes; below the least the recorder stops by itself."""
_STYLES = {"ok": "good", "warn": "open", "fail": "bad"}


@dataclass(frozen=True)
class Finding:
    """One line: ``level`` is ok, warn or fail; ``remedy`` is what to do."""

    level: str
    about: str
    found: str
    remedy: str = ""


def main(argv: Sequence[str]) -> int:
    """Print a line for each check; exit code 1 if one failed."""
    parser = cli.Parser(prog="trackway doctor", description=__doc__)
    parser.add_argument(
        "--patience",
        type=float,
        default=PATIENCE_S,
        metavar="S",
        help=f"longest wait for a message's round trip (default: {PATIENCE_S:g})",
    )
    args = parser.parse_args(argv)
    if not 0 < args.patience <= LONGEST_S:
        parser.error(f"--patience: {args.patience:g} is not above 0 and up to {LONGEST_S:g} s")
    return tell(checks(args))


def tell(findings: Iterable[Finding]) -> int:
    """Print findings as they come; 1 if one of them is a failure."""
    failed = False
    for one in findings:
        print(f"{styled(f'{one.level:<4}', _STYLES[one.level])}  {one.about:<14} {one.found}", flush=True)
        if one.remedy and one.level != "ok":
            print(f"{'':21}→ {one.remedy}", flush=True)
        failed |= one.level == "fail"
    return int(failed)


def checks(args: argparse.Namespace) -> Iterator[Finding]:
    """All of them, the quick ones first."""
    yield Finding("ok", "trackway", version())
    yield python()
    yield wheels(ROOT / "requirements.lock", _installed())
    yield workspace(ROOT / "ros_ws")
    yield ros2(real_ros2())
    yield messages(lambda: round_trip_s(args.patience))
    yield shared_memory(SHARED_MEMORY)
    yield cameras(sorted(Path("/dev").glob("video*")))
    yield disk("disk, here", Path.cwd())
    yield disk("disk, temporary", Path(tempfile.gettempdir()))
    yield browser(shutil.which)


def python(version: tuple[int, ...] = sys.version_info[:3]) -> Finding:
    """3.11 or newer."""
    told = ".".join(map(str, version))
    if version < (3, 11):
        remedy = "make clean && make PYTHON=python3.11 setup"
        return Finding("fail", "Python", f"{told}, 3.11 or newer is needed", remedy)
    return Finding("ok", "Python", told)


def wheels(lock: Path, installed: dict[str, str]) -> Finding:
    """What requirements.lock pins, by name."""
    pinned = re.findall(r"^([\w.-]+)==([\w.+!-]+)", lock.read_text(encoding="utf-8"), flags=re.M)
    other = [name for name, version in pinned if installed.get(_plain(name)) != version]
    if not other:
        return Finding("ok", "wheels", f"{len(pinned)}, as requirements.lock pins them")
    few = ", ".join(other[:4]) + (", …" if len(other) > 4 else "")
    return Finding(
        "warn",
        "wheels",
        f"{len(other)} of {len(pinned)} are missing or of another version: {few}",
        f"{sys.executable} -m pip install --no-deps -r {lock}",
    )


def workspace(workspace: Path) -> Finding:
    """Every package with a source is built."""
    missing = [
        one.parent.name
        for one in sorted(workspace.glob("src/*/package.xml"))
        if not (workspace / "install" / one.parent.name).is_dir()
    ]
    if missing:
        return Finding("fail", "workspace", f"not built: {', '.join(missing)}", "make setup")
    return Finding("ok", "workspace", "built")


def ros2(real: str | None) -> Finding:
    """Which ros2 answers."""
    if real is not None:
        return Finding("ok", "ros2", f"the real one, {real}")
    return Finding("ok", "ros2", "the project's fallback (ros2 --help says what it covers)")


def messages(trip: Callable[[], float | str]) -> Finding:
    """A message from one process to another over DDS."""
    domain, reach = os.environ.get("ROS_DOMAIN_ID", "0"), os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    where = f"domain {domain}, range {reach}"
    took = trip()
    if isinstance(took, str):
        remedy = "look for a firewall on the loopback device; try another ROS_DOMAIN_ID; clear shared memory (below)"
        return Finding("fail", "DDS", f"no message came back from another process: {took} ({where})", remedy)
    return Finding("ok", "DDS", f"a message went to another process and back in {1e3 * took:.1f} ms ({where})")


def shared_memory(folder: Path) -> Finding:
    """What nodes that were killed have left there, 70 MB each."""
    left = list(leftovers(folder))
    size = sum(path.stat().st_size for path in left)
    total, _, free = shutil.disk_usage(folder) if folder.is_dir() else (0, 0, 0)
    files = f"{len(left)} file{'s' * (len(left) != 1)}"
    told = f"{size / MIB:.0f} MB in {files} of nodes that were killed; {free / GIB:.1f} GB free"
    remedy = f"stop all nodes, then: rm -f {folder}/fastrtps_* {folder}/sem.fastrtps_*"
    if total < NEEDED_BYTES:
        told = f"{folder} is {total / MIB:.0f} MB, nodes need {NEEDED_BYTES >> 20}"
        return Finding(
            "fail", "shared memory", told, f"docker run --shm-size=1g, or: mount -o remount,size=1g {folder}"
        )
    if free + size < NEEDED_BYTES:
        remedy = f"{folder} is {total / GIB:.1f} GB: end what else uses it, or: mount -o remount,size=1g {folder}"
    if free < NEEDED_BYTES:
        return Finding("fail", "shared memory", told, remedy)
    return Finding("warn" if left else "ok", "shared memory", told if left else f"{free / GIB:.1f} GB free", remedy)


def leftovers(folder: Path) -> Iterator[Path]:
    """Segments and ports of Fast DDS that no living process holds: each has a lock file that is then free."""
    for lock in sorted(folder.glob("fastrtps_*_el")):
        segment = lock.with_name(lock.name.removesuffix("_el"))
        if segment.exists() and not _held(lock):
            yield segment


def _held(lock: Path) -> bool:
    try:
        with lock.open("rb+") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False


def cameras(devices: Sequence[Path]) -> Finding:
    """Cameras of this host; none is no fault."""
    unreadable = [device for device in devices if not os.access(device, os.R_OK | os.W_OK)]
    if unreadable:
        return Finding("warn", "cameras", f"no permission for {_names(unreadable)}", "add yourself to the group video")
    if not devices:
        return Finding("ok", "cameras", "none here; films and the virtual lab need none")
    return Finding("ok", "cameras", _names(devices))


def disk(about: str, folder: Path) -> Finding:
    """Room for bags."""
    free = shutil.disk_usage(folder).free
    level = "fail" if free < LEAST else "warn" if free < LITTLE else "ok"
    return Finding(level, about, f"{free / GIB:.1f} GB free at {folder}", "free some, or record elsewhere")


def browser(which: Callable[[str], str | None]) -> Finding:
    """Chromium, which only the browser tests need."""
    missing = [name for name in ("chromium", "chromedriver") if which(name) is None]
    if missing:
        return Finding("warn", "chromium", f"no {' and no '.join(missing)}: browser tests can't run", "make browser")
    return Finding("ok", "chromium", str(which("chromium")))


def round_trip_s(patience_s: float) -> float | str:
    """How long a message takes to another process and back once they have found each other, or why none came."""
    command = [sys.executable, "-m", "trackway_command.ping", f"{patience_s}"]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'tools'}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    echo = subprocess.Popen([*command, "echo"], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        asked = subprocess.run(
            [*command, f"{echo.pid}"], env=environment, capture_output=True, text=True, timeout=patience_s + 10.0
        )
        if asked.returncode == 0:
            return float(asked.stdout)
        return (asked.stderr.strip().splitlines() or [f"within {patience_s:g} s"])[-1]
    except subprocess.TimeoutExpired:
        return f"within {patience_s + 10.0:g} s"
    finally:
        _end(echo)


def _end(process: "subprocess.Popen[bytes]") -> None:
    # Asked, not killed: it leaves no shared memory behind.
    process.terminate()
    try:
        process.wait(5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _installed() -> dict[str, str]:
    return {_plain(one.metadata["Name"]): one.version for one in distributions() if one.metadata["Name"]}


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _names(paths: Sequence[Path]) -> str:
    return ", ".join(map(str, paths))
