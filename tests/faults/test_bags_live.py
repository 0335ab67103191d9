"""The recorder as a process over DDS: nothing lost, killed at any moment, on a full disk, started and stopped."""

import contextlib
import os
import pty
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import bags
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from starved import Starved

from sandbot_common import topics
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.bags.recover import recover
from sandbot_record.bags.writer import BagWriter
from sandbot_record.tools.record import main as record_main

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300)]

PUBLISHER = """
import sys, time
import numpy as np, rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Range
from sandbot_common import messages, topics
from sandbot_common.ros.endpoints import publisher
from sandbot_common.ros.node import use_shared_memory
use_shared_memory(frames=True)
rclpy.init()
node = Node("source")
legs, trial = publisher(node, topics.LEG_STATES), publisher(node, topics.TRIAL)
image = publisher(node, topics.DORSAL_IMAGE)
weak = node.create_publisher(Range, "/bed/height", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
trial.publish(messages.string('{"trial_id": "t1"}'))
frame = np.arange(480 * 640, dtype=np.uint8).reshape(480, 640)
rate, count, frames, *heard = float(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "True", *sys.argv[4:]
outlets = {"legs": legs, "trial": trial, "image": image, "height": weak}
while not all(outlets[name].get_subscription_count() for name in heard):
    time.sleep(0.02)
print("go", flush=True)
start, zero = time.monotonic(), np.zeros(6)
for i in range(count):
    legs.publish(messages.joint_state(time.time_ns(), topics.LEGS, zero + i, zero, zero))
    if i % 20 == 0:
        weak.publish(messages.range_(i, 0.1, 0.0, 1.0, "bed"))
        if frames:
            frame[0, :4] = np.frombuffer(i.to_bytes(4, "little"), np.uint8)
            image.publish(messages.image(i, "dorsal", frame))
    time.sleep(max(0.0, start + (i + 1) / rate - time.monotonic()))
assert all(one.wait_for_all_acked(Duration(seconds=60)) for one in (legs, trial, image))
print("done", flush=True)
"""


@pytest.fixture(autouse=True)
def unheard(domain):
    """Other tests are not heard."""


@contextlib.contextmanager
def process(*command, **options):
    with subprocess.Popen(
        [sys.executable, *map(str, command)], stdout=subprocess.PIPE, text=True, **options
    ) as started:
        try:
            yield started
        finally:
            started.kill()


def recorder(*arguments, **options):
    return process("-X", "faulthandler", "-m", "sandbot_record.tools.record", *arguments, **options)


def publisher(rate, count, *heard, frames=False):
    """``count`` numbered messages on /leg_states, and frames, as soon as there are ears for what is to be heard."""
    return process("-c", PUBLISHER, rate, count, frames, *heard)


def until(started: subprocess.Popen, beginning: str) -> str:
    for line in started.stdout:
        if line.startswith(beginning):
            return line
    raise AssertionError(f"no line {beginning!r}; exit code {started.wait()}")


def test_records_everything_and_matches_the_publishers_qos(tmp_path):
    names = ("/leg_states", "/trial", "/bed/height", "/speed")
    with recorder(*names, "--out", tmp_path / "b") as record, publisher(500, 1500, "legs", "trial", "height") as source:
        until(record, "recording to")
        until(source, "done")
        record.send_signal(signal.SIGINT)
        last = record.stdout.read()
        assert record.wait(60) == 0
    assert "0 lost" in last
    bag = Bag.open(tmp_path / "b")
    legs = bag.columns("/leg_states", "position", *FIELD_STAMP)
    assert legs["position"][:, 0].tolist() == list(range(1500))
    # Published after it was stamped, received after it was published.
    assert (legs.stamp_ns <= legs.publish_time_ns).all()
    assert (legs.publish_time_ns <= legs.log_time_ns).all()
    assert bag.topics["/trial"].count == 1  # latched, published before the recorder was there
    assert bag.topics["/bed/height"].count == 75  # best effort
    with Reader(tmp_path / "b") as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == bag.count
    assert bag.provenance["recording"]["exit_status"] == "ok"


@pytest.mark.parametrize("how", [signal.SIGTERM, "service"])
def test_stops_cleanly(tmp_path, how):
    with (
        recorder("--all", "--images", "jpeg", "--out", tmp_path / "b") as record,
        publisher(200, 400, "legs", "image", frames=True) as source,
    ):
        until(record, "recording to")
        until(source, "done")
        if how == "service":
            stop_by_service()
        else:
            record.send_signal(how)
        assert record.wait(60) == 0
    bag = Bag.open(tmp_path / "b")
    assert bag.topics["/leg_states"].count == 400
    assert bag.topics["/camera/dorsal/image_raw/compressed"].count == 20
    assert "/camera/dorsal/image_raw" not in bag.topics


CALLER = """
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("caller")
stop, start = (node.create_client(Trigger, f"/recorder/{name}") for name in ("stop", "start"))
assert stop.wait_for_service(60)
assert start.wait_for_service(60)

def answer(client, patience_s):
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=patience_s)
    return future.result()

# A server that has not met its client yet loses the answer, and this one stops once. It meets clients in their order.
while answer(start, 1) is None:
    pass
assert answer(stop, 60).success
"""


def stop_by_service() -> None:
    subprocess.run([sys.executable, "-c", CALLER], check=True, timeout=180)


@pytest.mark.parametrize("batches", [2, pytest.param(10, marks=pytest.mark.whole)])
def test_killed_at_any_moment_all_but_the_last_second_comes_back(tmp_path, batches):
    draw = random.Random(9)
    with publisher(1000, 200_000) as source:
        until(source, "go")
        for batch in range(batches):
            bags = [tmp_path / f"b{batch}{n}" for n in range(2)]  # more at once would starve on two cores
            with contextlib.ExitStack() as stack:
                kills = [heard(stack, source, bag, "/leg_states") for bag in bags]
                for kill, bag in zip(kills, bags, strict=True):
                    kill.after(draw.uniform(0.1, 1.2))
                    check_recovered(bag, kill)


class AllButTheLastSecond:
    """Kills a recorder; what was recovered then may lack a second, and what the machine held both ends up for."""

    def __init__(self, record: subprocess.Popen, source: subprocess.Popen) -> None:
        self._record, self._starved = record, Starved(record.pid, source.pid)

    def after(self, lived_s: float) -> None:
        time.sleep(lived_s)
        self.starved_ns = self._starved.ns
        self._killed_ns = time.time_ns()
        self._record.kill()
        self._record.wait()

    def includes(self, last_ns: int) -> bool:
        return self._killed_ns - last_ns < 1_000_000_000 + self.starved_ns


def heard(stack: contextlib.ExitStack, source: subprocess.Popen, bag: Path, *arguments: str) -> AllButTheLastSecond:
    """A recorder that has heard something: before, there may be nothing to bring back.

    One that hears nothing says where its threads are (on stderr).
    """
    record = stack.enter_context(recorder(*arguments, "--out", bag))
    until(record, "recording to")
    killed = AllButTheLastSecond(record, source)
    deadline = time.monotonic() + 60
    while Bag.open(bag, strict=False).count == 0:
        if time.monotonic() > deadline:
            ended = record.poll()
            record.send_signal(signal.SIGABRT)
            pytest.fail(f"{bag.name}: nothing came within a minute; exit code then {ended}, now {record.wait(10)}")
        time.sleep(0.05)
    return killed


def check_recovered(bag: Path, killed: AllButTheLastSecond) -> None:
    target = bag.with_name(f"{bag.name}-recovered")
    recover(bag, target)
    legs = Bag.open(target).columns("/leg_states", "position", *FIELD_STAMP)
    numbers = legs["position"][:, 0]
    # In order and none twice. What DDS drops while both ends are starved, a thousand in a second, never reached the
    # recorder; a chunk lost in the kill would be a thousand messages more.
    assert (np.diff(numbers) >= 1).all()
    assert np.diff(numbers).max(initial=0) < 300 + killed.starved_ns / 1_000_000
    assert killed.includes(legs.log_time_ns[-1])
    with Reader(target) as reader:
        assert sum(1 for _ in reader.messages()) == reader.message_count == len(numbers)
    shutil.rmtree(bag)


IMAGES = "/camera/dorsal/image_raw"


def frame_numbers(bag: Path) -> list[int]:
    """The numbers drawn into the frames; each must be the one its stamp says."""
    found = []
    timeline = Timeline(Bag.open(bag), [IMAGES])
    for index in range(len(timeline)):
        message = timeline[index].decode()
        found.append(int.from_bytes(message.data[:4].tobytes(), "little"))
        assert found[-1] == message.header.stamp.nanosec
    return found


@pytest.mark.parametrize("codec", [pytest.param("rawvideo", marks=pytest.mark.whole), "ffv1"])
def test_frames_in_a_video_are_all_there_and_outlive_a_kill(tmp_path, codec):
    video = ("--images", "video", "--video-codec", codec)
    names = ("/leg_states", IMAGES)
    with (
        recorder(*names, *video, "--out", tmp_path / "a") as record,
        publisher(400, 1200, "legs", "image", frames=True) as source,
    ):
        until(record, "recording to")
        until(source, "done")
        record.send_signal(signal.SIGINT)
        assert "0 lost" in record.stdout.read()
        assert record.wait(60) == 0
    assert frame_numbers(tmp_path / "a") == list(range(0, 1200, 20))
    draw = random.Random(4)
    with publisher(400, 100_000, frames=True) as source:
        until(source, "go")
        for number in range(3):
            bag = tmp_path / f"k{number}"
            with contextlib.ExitStack() as stack:
                killed = heard(stack, source, bag, *names, *video)
                killed.after(draw.uniform(0.5, 1.5))
            recover(bag, tmp_path / f"r{number}")
            frames = frame_numbers(tmp_path / f"r{number}")
            assert (np.diff(frames) == 20).all()
            last = Timeline(Bag.open(tmp_path / f"r{number}"), [IMAGES]).times_ns[-1]
            assert killed.includes(last)


def test_a_video_that_no_longer_fits_stops_the_recording_and_says_so(tmp_path):
    limit = 20_000_000

    def small_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    command = ("/leg_states", IMAGES, "--images", "video", "--out", tmp_path / "b")
    with (
        recorder(*command, preexec_fn=small_files) as record,
        publisher(1000, 8000, "legs", "image", frames=True) as source,
    ):
        until(source, "go")
        last = record.stdout.read()
        assert record.wait(60) == 1
    assert ".avi: File too large" in last
    assert Bag.open(tmp_path / "b").topics["/leg_states"].count > 500
    recover(tmp_path / "b", tmp_path / "r")
    frames = frame_numbers(tmp_path / "r")
    assert len(frames) >= limit // (480 * 640) - 2
    assert (np.diff(frames) == 20).all()


def test_a_full_disk_closes_the_bag_and_says_so(tmp_path):
    limit = 400_000

    def small_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    with (
        recorder("/leg_states", "--out", tmp_path / "b", preexec_fn=small_files) as record,
        publisher(500, 4000, "legs") as source,
    ):
        until(source, "go")
        last = record.stdout.read()
        assert record.wait(60) == 1
    assert "File too large" in last
    bag = Bag.open(tmp_path / "b")
    numbers = bag.columns("/leg_states", "position")["position"][:, 0]
    assert (np.diff(numbers) == 1).all()
    assert len(numbers) > 500
    assert "File too large" in bag.provenance["recording"]["exit_status"]
    with Reader(tmp_path / "b") as reader:
        assert sum(1 for _ in reader.messages()) == reader.message_count == len(numbers)


def test_replayed_is_what_was_recorded(tmp_path):
    with recorder("/leg_states", "--out", tmp_path / "a") as record, publisher(200, 600, "legs") as source:
        until(record, "recording to")
        until(source, "done")
        record.send_signal(signal.SIGINT)
        assert record.wait(60) == 0
    arguments = (tmp_path / "a", "--start", 1, "--rate", 2, "--clock", "--remap", "/leg_states:=/again")
    with (
        replay_at_a_terminal(*arguments, "--delay", 3) as (strike, replay),
        recorder("/again", "/clock", "--out", tmp_path / "b") as record,
    ):
        strike(" ")
        until(record, "recording to")  # which it says of topics with a publisher that it has met
        strike(" ")
        line = until(replay, "replayed")
        assert replay.wait(60) == 0
        record.send_signal(signal.SIGINT)
        assert record.wait(60) == 0
    first, second = Bag.open(tmp_path / "a"), Bag.open(tmp_path / "b")
    again = second.columns("/again", "position")
    numbers = again["position"][:, 0].astype(int)
    assert numbers.tolist() == list(range(numbers[0], 600))
    original = first.columns("/leg_states").log_time_ns
    start_ns = first.start_ns + 1_000_000_000  # of the bag: how many came before then is the talker's and the machine's
    assert numbers[0] == np.searchsorted(original, start_ns)
    # Half of the messages later, twice as soon: the median, and what the replay says that the machine held it up.
    half = len(numbers) // 2
    took, had_taken = (np.median(t_ns[half:] - t_ns[:-half]) for t_ns in (again.log_time_ns, original[numbers[0] :]))
    held_up_ns = 1e6 * float(re.search(r"(\S+) \(worst\)", line)[1])
    assert 0.85 * had_taken <= 2 * took <= 1.15 * had_taken + 2 * held_up_ns
    assert second.topics["/clock"].count > 50
    assert "late by" in line


FLOOD = """
import time
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node("flood")
qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
outlets = [node.create_publisher(JointState, "/leg_states", qos) for _ in range(2)]
state = JointState(effort=[0.0] * 20_000)
print("there", flush=True)
input()
while not all(one.get_subscription_count() for one in outlets):
    time.sleep(0.02)
for _ in range(1000):
    for one in outlets:
        one.publish(state)
print("done", flush=True)
time.sleep(1.0)
"""


def flooded(out):
    """Record a flood: what the bag says was written and lost, and the recorder's last words."""
    with process("-c", FLOOD, stdin=subprocess.PIPE) as source, recorder("/leg_states", "--out", out) as record:
        until(source, "there")
        until(record, "recording to")  # it has met both
        source.stdin.write("\n")
        source.stdin.flush()
        until(source, "done")
        record.send_signal(signal.SIGINT)
        last = record.stdout.read()
        assert record.wait(60) == 0
    told = Bag.open(out).provenance["recording"]["/leg_states"]
    written, lost = (int(number) for number in re.findall(r"(?:written|lost) (\d+)", told))
    return written, lost, last


def test_what_the_middleware_lost_is_counted_also_of_two_publishers(tmp_path):
    """Two publishers: gaps in their numbers can't be told apart, only the middleware's own count is left."""
    # A machine that is busy enough floods no faster than it records: then once more.
    floods = (flooded(tmp_path / str(number)) for number in range(5))
    written, lost, last = next((one for one in floods if one[1]), (0, 0, ""))
    assert written > 0
    assert lost > 0
    assert written + lost <= 2000  # what was lost after the last one that came, nobody can see
    assert f"{lost} lost (/leg_states {lost})" in last


MARKER = """
import time, rclpy
from visualization_msgs.msg import Marker
rclpy.init()
outlet = rclpy.create_node("viewer").create_publisher(Marker, "/viewer/marker", 10)
print("go", flush=True)
while True:
    outlet.publish(Marker())
    time.sleep(0.05)
"""
NOT_INSTALLED = """
import sys
sys.modules["visualization_msgs"] = None  # as on a host without the package
from sandbot_record.tools.record import main
raise SystemExit(main(sys.argv[1:]))
"""


def test_a_type_that_is_not_installed_is_named_once_and_the_rest_recorded(tmp_path):
    with (
        process("-c", MARKER) as viewer,
        process("-c", NOT_INSTALLED, "--all", "--out", tmp_path / "b") as record,
        publisher(200, 400, "legs") as source,
    ):
        until(viewer, "go")
        refusal = until(record, "not recording")
        until(source, "done")
        record.send_signal(signal.SIGINT)
        rest = record.stdout.read()
        assert record.wait(60) == 1
    assert "/viewer/marker: type visualization_msgs/msg/Marker is not installed here" in refusal
    assert "not recording" not in rest
    assert "1 topic not recorded (/viewer/marker)" in rest
    bag = Bag.open(tmp_path / "b")
    assert bag.topics["/leg_states"].count == 400
    assert "incomplete, not recorded: /viewer/marker" in bag.provenance["recording"]["exit_status"]


UP, DOWN, RIGHT, LEFT = "\x1b[A", "\x1b[B", "\x1b[C", "\x1b[D"


@contextlib.contextmanager
def replay_at_a_terminal(*arguments):
    """A replay whose stdin is a terminal, listening; how to strike keys, and the process."""
    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    try:
        with process("-m", "sandbot_record.tools.replay", *arguments, stdin=slave) as replay:
            deadline = time.monotonic() + 60
            while termios.tcgetattr(slave)[3] & termios.ICANON:
                assert time.monotonic() < deadline
                time.sleep(0.02)
            yield lambda keys: os.write(master, keys.encode()), replay
        assert termios.tcgetattr(slave) == before
    finally:
        os.close(master)
        os.close(slave)


def slow_bag(path: Path) -> Path:
    """A minute of 100 Hz."""
    with BagWriter(path) as writer:
        for index in range(6001):
            t_ns = bags.T0 + index * 10_000_000
            writer.write(topics.LEG_STATES, bags.joint_state(index, t_ns), t_ns)
    return path


def test_keys_pause_seek_and_change_the_rate(tmp_path):
    bag = slow_bag(tmp_path / "b")
    with replay_at_a_terminal(bag, "--until", "1") as (strike, replay):
        strike(" ")
        with pytest.raises(subprocess.TimeoutExpired):
            replay.wait(4)
        strike(" ")
        assert "replayed 101 messages" in until(replay, "replayed")
        assert replay.wait(60) == 0
    with replay_at_a_terminal(bag) as (strike, replay):
        strike(LEFT + RIGHT * 65)
        line = until(replay, "replayed")
        assert replay.wait(60) == 0
        assert int(line.split()[1]) < 3000  # most of it was passed over
    with replay_at_a_terminal(bag) as (strike, replay):
        start = time.monotonic()
        strike(DOWN + UP * 31)  # 1.1 to the power of 30: 17 times as fast
        assert "replayed 6001 messages" in until(replay, "replayed")
        assert time.monotonic() - start < 60  # without the keys it takes longer than that, whatever the machine
        assert replay.wait(60) == 0


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "nothing to record"),
        (("leg states",), "not a topic name"),
        (("--regex", "("), "not a regular expression"),
        (("/x", "--duration", "-1"), "--duration -1: more than 0"),
        (("/x", "--min-free", "1e11"), "MiB free"),
        (("/x", "--frob"), "no option --frob"),
    ],
)
def test_record_refuses_in_one_line(tmp_path, arguments, complaint, capsys):
    assert record_main([*arguments, "--out", str(tmp_path / "b")]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1
