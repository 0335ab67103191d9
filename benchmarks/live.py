"""Live trials through real nodes: how late a speed and a set-point are, beside a bare pair of rclpy nodes."""

import os
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
from sandbot_bringup import nodes  # noqa: E402
from sandbot_common import topics  # noqa: E402
from sandbot_record.bags.reader import FIELD_STAMP, Bag  # noqa: E402

RATE_HZ, SETPOINTS_HZ, BARE_S = 50.0, 1000.0, 10.0
"""Two cameras of 100 Hz, drawn and tracked, take both cores of a small machine: these are of 50. So do set-points of
1 kHz, for which clock, robot and campaign have real-time priority: a speed's lateness is asked at a plan's own rate."""
PLAN = {"name": "live", "seed": 5, "gait": "UNIFORM", "phi": [0.605], "omega_rad_s": [8.0], "replicates": 2,
        "periods": 8.0, "cameras": "cameras.yaml", "bed": BED}  # fmt: skip
PATIENT = {"clock.lease_s": 1.0, "clock.robot_s": 1.0, "clock.late_s": 0.25, "lab.legs_lease_s": 1.0,
           "lab.air_lease_s": 2.0, "bed.lease_s": 2.0}  # fmt: skip
CAMPAIGN_S = 300.0
_BARE = """
import sys, time, rclpy
from sensor_msgs.msg import Image
rclpy.init(); node = rclpy.create_node("bare_" + sys.argv[1]); late = []
if sys.argv[1] == "sends":
    sent, message = node.create_publisher(Image, "bare", 10), Image(data=bytes(640 * 480))
    def send():
        message.header.stamp = node.get_clock().now().to_msg(); sent.publish(message)
    node.create_timer(1 / float(sys.argv[3]), send)
else:
    def hear(message):
        stamp = message.header.stamp
        late.append(node.get_clock().now().nanoseconds - stamp.sec * 10**9 - stamp.nanosec)
    node.create_subscription(Image, "bare", hear, 10)
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
print(*late)
"""
"""One picture from one node to another, and nothing else."""
_found: list[Figure] = []


def main() -> str:
    """Markdown with what was measured."""
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name, own_domain(os.getpid()) as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        bare = bare_pair_ms()
        usual = [Bag.open(one) for one in campaign(Path(name) / "usual", PLAN)]
        speed = np.concatenate([late_ms(one, topics.SPEED.name) for one in usual])
        fast = [Bag.open(one) for one in campaign(Path(name) / "fast", {**PLAN, "setpoint_rate_hz": SETPOINTS_HZ})]
        points = [setpoints(one) for one in fast]
    jitter = np.concatenate([one - np.median(one) for one in points])
    drift = max(abs(np.polyfit(np.arange(len(one)) / SETPOINTS_HZ / 60, one, 1)[0]) for one in points)
    beside = f"{len(speed)} frames; a bare pair {np.median(bare):.1f}, 99 % {np.percentile(bare, 99):.1f} ms"
    _found[:] = [
        Figure("exposure to /speed, at the recorder, median", beside, float(np.median(speed)), "≤ 5 ms"),
        Figure("exposure to /speed, at the recorder, 99 %", beside, float(np.percentile(speed, 99)), "≤ 15 ms"),
        Figure("set-points sent off their instants, 99 %", f"{len(jitter)} of 1 kHz",
               float(np.percentile(np.abs(jitter), 99)), "≤ 1 ms"),
        Figure("set-points: drift of their lateness", f"{len(fast)} trials", float(drift), "≤ 1 ms a minute"),
    ]  # fmt: skip
    note = (
        f"Virtual lab, two cameras of {RATE_HZ:g} Hz drawn and tracked on {os.cpu_count()} cores; set-points of 200 Hz "
        f"(a plan's own) for the first two rows, of {SETPOINTS_HZ:g} Hz for the others. The bare pair is one "
        "process that sends a picture of 640×480 at that rate and one that hears it, nothing else running of ours. "
        f"Load average {before:.1f} before, {os.getloadavg()[0]:.1f} after."
    )
    return "\n".join(["# Live", "", table(_found), "", note])


def figures() -> list[Figure]:
    """Those of the last ``main``."""
    return _found


def bare_pair_ms() -> NDArray[np.float64]:
    """Delays from one node to another."""
    words = [sys.executable, "-c", _BARE]
    hears, sends = (
        subprocess.Popen([*words, who, str(BARE_S), str(RATE_HZ)], stdout=subprocess.PIPE, text=True)
        for who in ("hears", "sends")
    )
    delays = hears.communicate()[0].split()
    sends.wait()
    return np.array(delays, float) * 1e-6


def campaign(folder: Path, plan: Mapping[str, Any]) -> Sequence[Path]:
    """The bags of a live campaign, of which a trial may have failed."""
    folder.mkdir()
    cameras = yaml.safe_load((nodes.table_path().parent / "cameras.yaml").read_text())
    for name in ("dorsal", "lateral"):
        cameras[name]["frame_rate_hz"] = RATE_HZ
    (folder / "cameras.yaml").write_text(yaml.safe_dump(cameras))
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
