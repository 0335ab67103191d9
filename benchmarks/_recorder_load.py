"""The live recorder under load: ×1 is 1 kHz JointState + 2 × 100 Hz of 640×480 images + 600 Hz of small messages."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sandbot_common import messages, topics
from sandbot_common.serialization import to_cdr
from sandbot_record.bags.reader import Bag

CAMERAS = (topics.DORSAL_IMAGE, topics.LATERAL_IMAGE)
SMALL = (topics.COM, topics.FRONT_AXLE, topics.REAR_AXLE, topics.SPEED, topics.DORSAL_INFO, topics.LATERAL_INFO)
DEPTH, CAMERA_DEPTH = 2000, 500
_READY_S = 1.5
"""From the first match of a subscription to the first message: matching takes a moment for each topic."""


@dataclass(frozen=True)
class Outcome:
    """One run: what was sent at which multiple of the load, and what became of it."""

    sent: int
    rate: float
    lost: int
    dropped: int
    held: int
    cpu: float
    replayed: str = ""


def section(seconds: float) -> list[str]:
    """×1 for ``seconds`` and with both cores busy, then rising multiples until something is lost; Markdown lines."""
    short = seconds / 3
    lines = [
        f"Live over DDS: {__doc__.partition(': ')[2]} Publishers' queues {DEPTH} (images {CAMERA_DEPTH}), recorder's "
        f"2000. CPU in % of one core; plain: writing the same bytes to a file, no ROS. Load average at the start "
        f"{os.getloadavg()[0]:.1f}.",
        "",
        "| load | s | reached | sent | lost on the way | dropped, disk too slow | in the bag | CPU | plain |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    first = _run(1, seconds, replay_s=min(10.0, seconds))
    lines.append(_row("×1", seconds, first, 1))
    with _busy_cores():
        lines.append(_row("×1, both cores busy", seconds, _run(1, seconds), 1))
    lossless, failed = 1.0, ""
    for rate in (2, 3, 4, 5, 6, 8):
        outcome = _run(rate, short)
        lines.append(_row(f"×{rate}", short, outcome, rate))
        if outcome.held < outcome.sent:
            failed = f"the first messages were lost at ×{rate}"
            break
        if outcome.rate < 0.95 * rate:
            failed = f"at ×{rate} the publisher could only send ×{outcome.rate:.1f}, of which nothing was lost"
            break
        lossless = rate
    return [*lines, "", f"Nothing was lost up to ×{lossless:g}; {failed}.", "", f"The ×1 bag again: {first.replayed}."]


def _row(name: str, seconds: float, got: Outcome, rate: float) -> str:
    figures = f"{got.sent} | {got.lost} | {got.dropped} | {got.held} | {got.cpu:.0f} % | {_plain_cpu(rate):.1f} %"
    return f"| {name} | {seconds:.0f} | ×{got.rate:.2f} | {figures} |"


def _run(rate: float, seconds: float, replay_s: float = 0.0) -> Outcome:
    domain = {**os.environ, "ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}
    names = [topics.LEG_STATES.name, *(topic.name for topic in (*CAMERAS, *SMALL))]
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        command = [sys.executable, "-m", "sandbot_record.tools.record", *names, "--out", str(bag)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=domain) as recorder:
            assert recorder.stdout is not None
            for line in recorder.stdout:
                if line.startswith("recording to"):
                    break
            before = _cpu_s(recorder.pid)
            load = [sys.executable, __file__, str(rate), str(seconds)]
            source = subprocess.run(load, stdout=subprocess.PIPE, text=True, env=domain, check=True)
            used = _cpu_s(recorder.pid) - before
            recorder.send_signal(signal.SIGINT)
            recorder.communicate()
        sent, spent, ticks = (float(word) for word in source.stdout.split())
        closed = Bag.open(bag)
        told = " ".join(closed.provenance["recording"].values())
        lost, dropped = (sum(map(int, re.findall(rf"{what} (\d+)", told))) for what in ("lost", "dropped"))
        replayed = _replay(bag, replay_s, domain) if replay_s else ""
    return Outcome(int(sent), ticks / 1000 / spent, lost, dropped, closed.count, 100 * used / spent, replayed)


def _replay(bag: Path, seconds: float, domain: dict[str, str]) -> str:
    command = [sys.executable, "-m", "sandbot_record.tools.replay", str(bag), "--until", str(seconds)]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, env=domain, check=True).stdout.strip()


def _plain_cpu(rate: float, seconds: float = 5.0) -> float:
    """CPU of writing as many bytes of as many messages to a file, in % of a core at that rate."""
    state, image, small = _payloads()
    with tempfile.TemporaryFile() as file:
        before = time.process_time()
        for tick in range(round(1000 * rate * seconds)):
            file.write(state)
            if tick % 10 == 0:
                for data in (*[image] * len(CAMERAS), *[data for _, data in small]):
                    file.write(data)
        return 100 * (time.process_time() - before) / seconds


@contextlib.contextmanager
def _busy_cores() -> Iterator[None]:
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _payloads() -> tuple[bytes, bytes, list[tuple[topics.Topic, bytes]]]:
    zero = np.zeros(6)
    frame = np.random.default_rng(1).integers(0, 255, (480, 640), dtype=np.uint8)
    point, twist = messages.point(0, zero[:3]), messages.twist(0, 0.0, 0.0, 0.0, 0.0)
    info = messages.camera_info(0, "dorsal", (640, 480), np.eye(3), [0.0] * 5)
    small = zip(SMALL, (point, point, point, twist, info, info), strict=True)
    state = to_cdr(messages.joint_state(0, topics.LEGS, zero, zero, zero))
    return state, to_cdr(messages.image(0, "dorsal", frame)), [(topic, to_cdr(message)) for topic, message in small]


def publish(rate: float, seconds: float) -> None:
    """Publish the load (a process of its own); print messages sent, seconds taken and ticks of 1 ms."""
    import rclpy
    from rclpy.qos import QoSProfile

    from sandbot_common.ros.node import use_shared_memory

    use_shared_memory(frames=True)
    rclpy.init()
    node = rclpy.create_node("load")

    def outlet(topic: topics.Topic, depth: int):  # type: ignore[no-untyped-def]
        return node.create_publisher(messages.message_class(topic.type), topic.name, QoSProfile(depth=depth))

    state, image, small = _payloads()
    legs = outlet(topics.LEG_STATES, DEPTH)
    others = [(outlet(topic, CAMERA_DEPTH), image) for topic in CAMERAS]
    others += [(outlet(topic, DEPTH), data) for topic, data in small]
    while not all(one.get_subscription_count() for one in (legs, *(one for one, _ in others))):
        time.sleep(0.02)
    time.sleep(_READY_S)
    start, ticks = time.monotonic(), round(1000 * rate * seconds)
    for tick in range(ticks):
        legs.publish(state)
        if tick % 10 == 0:
            for one, data in others:
                one.publish(data)
        if (ahead := start + (tick + 1) / (1000 * rate) - time.monotonic()) > 0:
            time.sleep(ahead)
    spent = time.monotonic() - start
    time.sleep(3.0)
    print(ticks + len(range(0, ticks, 10)) * len(others), spent, ticks)


if __name__ == "__main__":
    publish(float(sys.argv[1]), float(sys.argv[2]))
