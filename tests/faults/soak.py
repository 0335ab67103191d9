"""`make soak SOAK=30`: live trials back to back for that long; what grew, drifted or was lost: benchmarks/soak.md.

Every few seconds each process's own memory, threads and file descriptors are read, and the shared memory that all of
them map; every bag tells of lost messages and of its set-points. The recorder, new for each trial, has no growth.
"""

import argparse
import contextlib
import json
import math
import os
import platform
import re
import signal
import statistics
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from matrix import BED, Cell, run_main

from conftest import own_domain
from sandbot_bringup import node_table
from sandbot_bringup.journal import read_journal
from sandbot_bringup.plan import Plan, read_plan
from sandbot_clock.gait import leg_angles
from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.trials.from_bags import bags_in, start_ns

PAGE = Path(__file__).resolve().parents[2] / "benchmarks" / "soak.md"
EVERY_S = 5.0
STALL_S, STALLS = 6.0, 4
RATE_HZ = 50.0
"""Of the cameras: two of them rendered and tracked at 100 Hz take both cores of a small machine."""
PLAN = {"name": "soak", "seed": 5, "gait": "UNIFORM", "phi": [0.605, 0.615], "omega_rad_s": [8.0, 10.0, 12.0],
        "replicates": 500, "periods": 6.0, "cameras": "cameras.yaml", "bed": BED}  # fmt: skip
PATIENT = {"clock.lease_s": 1.0, "clock.robot_s": 1.0, "clock.late_s": 0.25, "lab.legs_lease_s": 1.0,
           "lab.air_lease_s": 2.0, "bed.lease_s": 2.0}  # fmt: skip
"""Leases that a busy machine seldom loses."""
SETTLED = 1 / 6
"""Part of the run in which processes may still load and fill what they keep."""
GROWTH = {"memory_mb": 2.0, "threads": 0, "files": 0, "shared_mb": 0.0, "segments": 0}
"""How much more the last third may have than the first settled one; memory 5 % beside it."""
UNITS = {"memory_mb": "own memory [MB]", "threads": "threads", "files": "open files", "shared_mb": "shared memory [MB]",
         "segments": "segments of shared memory"}  # fmt: skip
NAMES = {"recorder": "sandbot_record.tools.record", "campaign": "sandbot_bringup.tools.campaign import main; "
         "sys.exit(main(sys.argv[1:]))", "launch": "ros2 launch"}  # fmt: skip
NAMES |= {name: f"/lib/sandbot_{package}/{name}" for name, package in {
    "clock": "clock", "bed": "bed", "lab": "lab", "tracker": "tracking", "predictor": "model", "console": "bringup"
}.items()}  # fmt: skip
ALL = NAMES.keys() - {"recorder"}
PER_PROCESS, PER_TRACKWAY = ("memory_mb", "threads", "files"), ("shared_mb", "segments")
DRIFT_RAD = 1e-6
_SEGMENT = re.compile(r"(/dev/shm/\S+)(?: \(deleted\))?$", re.M)


@dataclass(frozen=True)
class Trial:
    """What one bag tells."""

    name: str
    minute: float
    lost: int
    losses: Mapping[str, int]
    """Those that lost any."""
    written: int
    missed: int
    """Set-points that the schedule has and the bag has not."""
    off_rad: float
    """How far a set-point was off the gait's formula at its instant, at worst."""
    late_ms: tuple[float, float]
    """From a set-point's instant to its arrival at the recorder: median, 99 %."""


def measured(process: psutil.Process) -> dict[str, float]:
    """Own memory, threads and open files of one process."""
    with process.oneshot():
        own_mb = process.memory_full_info().uss / 2**20
        return {"memory_mb": own_mb, "threads": process.num_threads(), "files": process.num_fds()}


def segments(pids: Sequence[int]) -> dict[str, float]:
    """How much shared memory they map between them, each segment once."""
    found: set[str] = set()
    size = 0
    for pid in pids:
        with contextlib.suppress(OSError):  # it has just ended
            found |= set(_SEGMENT.findall(Path(f"/proc/{pid}/maps").read_text()))
    for path in found:
        with contextlib.suppress(OSError):
            size += os.stat(path).st_size
    return {"shared_mb": size / 2**20, "segments": len(found)}


def sample(cell: Cell) -> dict[str, dict[str, float]]:
    """What each process of the trackway has now, by its name; ``all`` has what they share."""
    found, pids = {}, []
    for pid in cell.marked():
        try:
            process = psutil.Process(pid)
            name = name_of(process.cmdline())
            if name in ALL:
                found[name] = measured(process)
                pids.append(pid)
        except (psutil.Error, OSError):  # it has just ended
            continue
    return {**found, "all": segments(pids)}


def name_of(command: Sequence[str]) -> str:
    """What a process of the trackway is called; empty for what they start beside it."""
    text = f"{' '.join(command)} "
    return next((name for name, words in NAMES.items() if f"{words} " in text), "")


def trial_of(bag: Path, plan: Plan, zero_s: float) -> Trial:
    """The messages a bag has lost, and its set-points beside the schedule and the gait's formula."""
    opened = Bag.open(bag)
    tallies = {name: text for name, text in opened.provenance["recording"].items() if name.startswith("/")}
    losses = {name: sum(map(int, re.findall(r"(?:lost|dropped) (\d+)", text))) for name, text in tallies.items()}
    lost = sum(losses.values())
    points = opened.columns(topics.LEG_SETPOINTS.name, "position", "velocity", *FIELD_STAMP)
    stamp_ns = points.stamp_ns
    period_ns = round(1e9 / plan.setpoint_rate_hz)
    walking = np.asarray(points["velocity"]).any(axis=1)
    t_s = (stamp_ns - stamp_ns[0])[walking] * 1e-9
    omega = json.loads(opened.provenance["trial"]["parameters"])["omega_rad_s"]
    told = leg_angles(plan.clock_gait, omega, t_s)[0]
    off = np.asarray(points["position"])[walking] - told
    off = np.abs((off + np.pi) % (2 * np.pi) - np.pi)
    late_ms = (points.log_time_ns - stamp_ns) * 1e-6
    expected = round((stamp_ns[-1] - stamp_ns[0]) / period_ns) + 1
    return Trial(
        bag.name,
        (start_ns(opened) * 1e-9 - zero_s) / 60,
        lost,
        {name: count for name, count in losses.items() if count},
        opened.count,
        expected - len(stamp_ns),
        float(off.max()),
        (float(np.median(late_ms)), float(np.percentile(late_ms, 99))),
    )


def grown(values: Sequence[float], allowed: float, share: float = 0.0) -> bool:
    """Whether the last third of a run has more than its first settled third by more than is allowed."""
    before, after = ends(values)
    return after - before > allowed + share * before


def series(samples: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, list[float]]]:
    """Quantity by quantity and process by process."""
    names = [name for name in samples[-1] if name != "minute"]
    return {
        quantity: {name: [one[name][quantity] for one in samples] for name in names if quantity in samples[-1][name]}
        for quantity in GROWTH
    }


def growths(found: Mapping[str, Mapping[str, Sequence[float]]]) -> list[str]:
    """What grew, one line each."""
    return [
        f"{name}: {UNITS[quantity]}"
        for quantity, by_name in found.items()
        for name, values in by_name.items()
        if grown(values, GROWTH[quantity], 0.05 if quantity == "memory_mb" else 0.0)
    ]


def fill_queues(cell: Cell, ended: threading.Event) -> None:
    """Hold those up who get frames, again and again.

    Queues of 200 frames (0.3 MB each, two cameras) keep the memory they have once taken; a busy machine fills them at
    some time of its own (measured: the lab goes from 150 to 230 MB in two stalls, the tracker from 104 to 236, and
    then no further). Filled before the run, they are no growth in it.
    """
    names = {"tracker", "console"}
    until = time.monotonic() + 90.0
    while time.monotonic() < until and not names <= cell_names(cell).keys():
        ended.wait(1.0)
    ended.wait(15.0)  # for the first frames
    for _ in range(STALLS):
        held = [pid for name, pid in cell_names(cell).items() if name in names]
        for pid in held:
            os.kill(pid, signal.SIGSTOP)
        ended.wait(STALL_S)
        for pid in held:
            os.kill(pid, signal.SIGCONT)
        ended.wait(STALL_S)


def cell_names(cell: Cell) -> dict[str, int]:
    """The processes of the trackway by name."""
    found = {}
    for pid in cell.marked():
        with contextlib.suppress(psutil.Error, OSError):
            found[name_of(psutil.Process(pid).cmdline())] = pid
    return found


def run(minutes: float, folder: Path) -> dict[str, object]:
    """Let the trackway run; the samples, and what the journal and the bags say."""
    cameras = yaml.safe_load((node_table.table_path().parent / "cameras.yaml").read_text())
    for name in ("dorsal", "lateral"):
        cameras[name]["frame_rate_hz"] = RATE_HZ
    (folder / "cameras.yaml").write_text(yaml.safe_dump(cameras))
    cell, samples, loads = Cell(folder, 1), [], []
    (folder / "soak.yaml").write_text(yaml.safe_dump(PLAN))
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    try:
        settings = {"console": "true", "console.port": 0, "cameras": folder / "cameras.yaml", **PATIENT}
        settings |= {f"bed.{key}": value for key, value in BED.items()}
        launch = ["ros2", "launch", "sandbot_bringup", "trackway.launch.py"]
        cell.start("launch", [*launch, *(f"{key}:={value}" for key, value in settings.items())])
        fill_queues(cell, ended)
        cell.start("campaign", [*run_main("sandbot_bringup.tools.campaign"), str(folder / "soak.yaml"), "--out",
                                str(folder / "campaign"), "--silence", "5"])  # fmt: skip
        zero_s = time.time()
        while time.time() - zero_s < minutes * 60 and cell.running["campaign"].poll() is None:
            ended.wait(EVERY_S)
            now = sample(cell) | {"minute": (time.time() - zero_s) / 60}
            if now.keys() >= ALL:  # not while they start
                samples.append(now)
            loads.append(os.getloadavg()[0])
            if ended.is_set():
                break
        cell.running["campaign"].send_signal(signal.SIGINT)
        cell.running["campaign"].wait(60)
    finally:
        cell.close()
    events = read_journal(folder / "campaign" / "journal.jsonl")
    plan = read_plan(folder / "soak.yaml")
    trials = []
    for bag in bags_in(folder / "campaign"):
        try:
            trials.append(vars(trial_of(bag, plan, zero_s)))
        except (InputError, LookupError) as error:
            print(f"{bag.name}: {error}", file=sys.stderr)
    return {
        "minutes": (time.time() - zero_s) / 60,
        "samples": samples,
        "failed": [one["reason"] for one in events if one["do"] == "failed"],
        "trials": sorted(trials, key=lambda one: one["minute"]),
        "load": [min(loads), statistics.median(loads), max(loads)],
    }


def rows(found: Mapping[str, Any]) -> list[str]:
    """The page's tables."""
    trials, failed = found["trials"], found["failed"]
    why = Counter(re.sub(r"[-\d.]+", "…", reason.split(";")[0]) for reason in failed)
    lost = sum(one["lost"] for one in trials)
    sent = sum(one["written"] for one in trials)
    losses = Counter[str]()
    for one in trials:
        losses.update(one["losses"])
    by_topic = ", ".join(f"{topic} {count}" for topic, count in losses.items())
    minutes, late = [one["minute"] for one in trials], [one["late_ms"][0] for one in trials]
    drift = np.polyfit(minutes, late, 1)[0] if len(trials) > 2 else math.nan
    lines = [
        "| what | found | aim |",
        "|---|---|---|",
        f"| trials kept | {len(trials)}; {len(failed)} marked as failed | |",
        f"| messages lost | {lost} of {sent:,}{f': {by_topic}' if lost else ''} | 0 |",
        f"| set-points off the gait's formula | {max(one['off_rad'] for one in trials):.1e} rad at worst | 0 |",
        f"| set-points left out, being late | {sum(one['missed'] for one in trials)} | |",
        f"| set-point to recorder, median | {np.median(late):.2f} ms; {drift:+.3f} ms a minute | |",
    ]
    lines += [f"| failed: {reason} | {count} | |" for reason, count in why.most_common()]
    lines += ["", "| process | memory [MB] | threads | open files |", "|---|---|---|---|"]
    by_quantity = series(found["samples"])
    for name in by_quantity["memory_mb"]:
        cells = [" → ".join(f"{value:.0f}" for value in ends(by_quantity[key][name])) for key in PER_PROCESS]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    shared = [" → ".join(f"{value:.0f}" for value in ends(by_quantity[key]["all"])) for key in PER_TRACKWAY]
    return [*lines, "", f"Shared memory of all: {shared[0]} MB in {shared[1]} segments."]


def page(found: Mapping[str, Any]) -> str:
    """benchmarks/soak.md."""
    low, usual, high = found["load"]
    grew = growths(series(found["samples"]))
    text = [
        "# Live trials back to back",
        "",
        f"{found['minutes']:.0f} minutes (`make soak SOAK=minutes`), nodes of the virtual lab with console, cameras of "
        f"{RATE_HZ:g} Hz, on {os.cpu_count()} cores beside other work: load average {low:.0f} to {high:.0f}, "
        f"{usual:.0f} in the median; {platform.machine()}, Python {platform.python_version()}.",
        "",
        f"Grown (medians of the last third beside the first, the first {SETTLED:.0%} left out; 2 MB and 5 % of memory, "
        f"nothing else allowed): {'; '.join(grew) or 'nothing'}.",
        "",
        *rows(found),
        "",
        "A trial is marked as failed where a busy machine has held it up for longer than its limits (a set-point 50 ms "
        "late, say). /operator/lease keeps one message by intent: only the latest counts. Queues of frames are filled "
        f"before the run ({STALLS} stalls of tracker and console): they keep the memory they have once taken.",
        "",
        "![Memory, threads, files, shared memory and set-points over the run](soak.png)",
    ]
    return "\n".join(text) + "\n"


def ends(values: Sequence[float]) -> tuple[float, float]:
    """Medians of the first settled third and the last."""
    settled = values[int(len(values) * SETTLED) :]
    third = max(len(settled) // 3, 1)
    return statistics.median(settled[:third]), statistics.median(settled[-third:])


def plot(found: Mapping[str, Any], path: Path) -> None:
    """One panel a quantity, over minutes."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(2, 3, figsize=(12, 6), layout="constrained", sharex=True)
    for panel, (quantity, by_name) in zip(panels.flat, series(found["samples"]).items(), strict=False):
        for name, values in by_name.items():
            panel.plot([one["minute"] for one in found["samples"]], values, label=name)
        panel.set_title(UNITS[quantity])
    panels[0, 0].legend(fontsize=7)
    last = panels[1, 2]
    for index, name in enumerate(("median", "99 %")):
        last.semilogy([one["minute"] for one in found["trials"]], [one["late_ms"][index] for one in found["trials"]],
                      ".", label=name)  # fmt: skip
    last.set_title("set-point to recorder [ms]")
    last.legend(fontsize=7)
    for panel in panels[1]:
        panel.set_xlabel("minutes")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main(argv: Sequence[str] | None = None) -> int:
    """Run, write the page; 1 where something grew or a message was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--page", type=Path, default=PAGE)
    options = parser.parse_args(argv)
    folder = Path(tempfile.mkdtemp(prefix="soak-"))
    with own_domain(int(os.environ.get("ROS_DOMAIN_ID", os.getpid()))) as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        found = run(options.minutes, folder)
    (folder / "soak.json").write_text(json.dumps(found))
    return told(found, options.page)


def told(found: Mapping[str, Any], path: Path) -> int:
    """Write page and plots; 1 where something grew, drifted or was lost."""
    text = page(found)
    path.write_text(text, encoding="utf-8")
    plot(found, path.with_suffix(".png"))
    print(text)
    drifted = any(one["off_rad"] > DRIFT_RAD for one in found["trials"])
    return int(bool(growths(series(found["samples"]))) or drifted or any(one["lost"] for one in found["trials"]))


if __name__ == "__main__":
    raise SystemExit(main())
