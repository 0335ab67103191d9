"""Live trials through real nodes: how late a speed and a set-point are, beside a bare pair of rclpy nodes."""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from _figures import Figure, table

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "faults"))

from matrix import BED, Cell, run_main  # noqa: E402  (their folder is no package)

from conftest import own_domain  # noqa: E402
from sandbot_bringup import node_table  # noqa: E402
from sandbot_common import topics  # noqa: E402
from sandbot_record.bags.reader import FIELD_STAMP, Bag  # noqa: E402

RATE_HZ, SETPOINTS_HZ, NODES_S, FIRST = 50.0, 1000.0, 15.0, 50
"""Two cameras of 100 Hz, drawn and tracked, take both cores of a small machine: these are of 50. So do set-points of
1 kHz, for which clock, robot and campaign have real-time priority: a speed's lateness is asked at a plan's own rate. In
the first frames of a driver the tracker looks everywhere."""
PLAN = {"name": "live", "seed": 5, "gait": "UNIFORM", "phi": [0.605], "omega_rad_s": [8.0], "replicates": 2,
        "periods": 8.0, "cameras": "cameras.yaml", "bed": BED}  # fmt: skip
PATIENT = {"clock.lease_s": 1.0, "clock.robot_s": 1.0, "clock.late_s": 0.25, "lab.legs_lease_s": 1.0,
           "lab.air_lease_s": 2.0, "bed.lease_s": 2.0}  # fmt: skip
CAMPAIGN_S = 300.0
_found: list[Figure] = []


def main() -> str:
    """Markdown with what was measured."""
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name, own_domain(os.getpid()) as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        bare, cameras = delays_ms("hears", "sends"), drivers_ms(Path(name) / "cameras.yaml")
        usual = [Bag.open(one) for one in campaign(Path(name) / "usual", PLAN)]
        speed = np.concatenate([late_ms(one, topics.SPEED.name) for one in usual])
        fast = [Bag.open(one) for one in campaign(Path(name) / "fast", {**PLAN, "setpoint_rate_hz": SETPOINTS_HZ})]
        points = [setpoints(one) for one in fast]
    jitter = np.concatenate([one - np.median(one) for one in points])
    drift = max(abs(np.polyfit(np.arange(len(one)) / SETPOINTS_HZ / 60, one, 1)[0]) for one in points)
    beside = f"bare pair of nodes: median {np.median(bare):.1f}, 99 % {np.percentile(bare, 99):.1f} ms"
    _found[:] = [
        *late("two camera drivers", cameras, beside),
        *late("the virtual lab's cameras", speed, beside),
        Figure("set-points: deviation from their scheduled times, 99 %", f"{len(jitter)} of 1 kHz",
               float(np.percentile(np.abs(jitter), 99)), "≤ 1 ms"),
        Figure("set-points: drift of their delay", f"{len(fast)} trials", float(drift), "≤ 1 ms a minute"),
    ]  # fmt: skip
    note = (
        f"Two cameras of {RATE_HZ:g} Hz, 640×480, tracked on {os.cpu_count()} cores. Drivers are processes of their "
        "own with pictures drawn before, stamped as they are sent, beside a bare pair: one process that sends such "
        "pictures and one that hears them. The virtual lab draws a frame at the next set-point after its exposure, up "
        f"to 5 ms later at a plan's 200 Hz; set-points of {SETPOINTS_HZ:g} Hz for the rows of set-points only. "
        f"Load average {before:.1f} before, {os.getloadavg()[0]:.1f} after."
    )
    return "\n".join(["# Live", "", table(_found), "", note])


def figures() -> list[Figure]:
    """Those of the last ``main``."""
    return _found


def late(whose: str, delays: NDArray[np.float64], beside: str) -> list[Figure]:
    """How late the speeds of these cameras are, in the middle and at the end."""
    return [
        Figure(f"exposure to /speed, {whose}, {of}", f"{len(delays)} frames; {beside}", float(value), aim)
        for of, value, aim in (("median", np.median(delays), "≤ 5 ms"), ("99 %", np.percentile(delays, 99), "≤ 15 ms"))
    ]


def drivers_ms(cameras: Path) -> NDArray[np.float64]:
    """Delays from two drivers' stamps to the speeds that the tracker makes of their pictures."""
    cameras.write_text(yaml.safe_dump(cameras_of_this()))
    words = ["ros2", "run", "sandbot_tracking", "tracker", "--ros-args", "-p", f"cameras:={cameras}"]
    tracker = subprocess.Popen(words)
    try:
        return delays_ms("speed", *topics.VIEWS)[FIRST:]
    finally:
        tracker.send_signal(signal.SIGINT)
        tracker.wait()


def delays_ms(hears: str, *sends: str) -> NDArray[np.float64]:
    """What this node of _live_nodes.py heard of those."""
    words = [sys.executable, str(HERE / "_live_nodes.py")]
    senders = [subprocess.Popen([*words, who, str(NODES_S), str(RATE_HZ)]) for who in sends]
    listener = [*words, hears, str(2 * NODES_S), str(RATE_HZ)]
    delays = subprocess.run(listener, stdout=subprocess.PIPE, text=True, check=True).stdout.split()
    for one in senders:
        one.wait()
    return np.array(delays, float) * 1e-6


def cameras_of_this() -> dict[str, Any]:
    """The virtual lab's cameras at this benchmark's rate."""
    cameras: dict[str, Any] = yaml.safe_load((node_table.table_path().parent / "cameras.yaml").read_text())
    for name in topics.VIEWS:
        cameras[name]["frame_rate_hz"] = RATE_HZ
    return cameras


def campaign(folder: Path, plan: Mapping[str, Any]) -> Sequence[Path]:
    """The bags of a live campaign, of which a trial may have failed."""
    folder.mkdir()
    (folder / "cameras.yaml").write_text(yaml.safe_dump(cameras_of_this()))
    (folder / "live.yaml").write_text(yaml.safe_dump(dict(plan)))
    cell, settings = Cell(folder, 1), {"cameras": folder / "cameras.yaml", **PATIENT}
    settings |= {f"bed.{key}": value for key, value in BED.items()}
    try:
        cell.start("launch", ["ros2", "launch", "sandbot_bringup", "trackway.launch.py",
                              *(f"{key}:={value}" for key, value in settings.items())])  # fmt: skip
        words = [str(folder / "live.yaml"), "--out", str(folder / "c"), "--silence", "5"]
        cell.start("campaign", [*run_main("sandbot_bringup.tools.campaign"), *words])
        cell.running["campaign"].wait(CAMPAIGN_S)
    finally:
        cell.close()
    # Those, too, that a busy machine has spoilt: how late it was is what is asked.
    bags = sorted(path.parent for path in (folder / "c" / "trials").glob("**/metadata.yaml"))
    if not bags:
        raise RuntimeError(f"no trial was recorded: {cell.last_line('campaign')}")
    return bags


def late_ms(bag: Bag, topic: str) -> NDArray[np.float64]:
    """From what a message is stamped with to its arrival at the recorder, while legs move."""
    columns = bag.columns(topic, *FIELD_STAMP)
    moving = _moving_ns(bag)
    kept = (columns.stamp_ns > moving[0]) & (columns.stamp_ns < moving[1])
    return np.asarray((columns.log_time_ns - columns.stamp_ns)[kept] * 1e-6)


def setpoints(bag: Bag) -> NDArray[np.float64]:
    """From the instant a set-point is for to its sending [ms]."""
    columns = bag.columns(topics.LEG_SETPOINTS.name, *FIELD_STAMP)
    return np.asarray((columns.publish_time_ns - columns.stamp_ns) * 1e-6)


def _moving_ns(bag: Bag) -> tuple[Any, Any]:
    points = bag.columns(topics.LEG_SETPOINTS.name, "velocity", *FIELD_STAMP)
    moving = points.stamp_ns[np.asarray(points["velocity"]).any(axis=1)]
    return moving[0], moving[-1]


if __name__ == "__main__":
    print(main())
