"""Bags: writing and reading beside rosbags and mcap's own tools, and the recorder under live load."""

import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapLibraryWriter
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

import _recorder_load
from _ratios import Ratio
from sandbot_common import messages, topics
from sandbot_common.serialization import to_cdr
from sandbot_record.bags import interfaces
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import BagWriter

COUNT, IMAGES = 20_000, 300
SECONDS = float(os.environ.get("RECORDING_SECONDS", "60"))
"""Length of the live run at ×1; the others last a third. Shorter for development only."""
T0 = 1_700_000_000_000_000_000
LEGS, IMAGE = topics.LEG_STATES, topics.DORSAL_IMAGE
Load = list[tuple[topics.Topic, bytes, int]]


def main() -> str:
    """The section of the report, in Markdown."""
    small, large = _load(COUNT, 0), _load(0, IMAGES)
    with tempfile.TemporaryDirectory() as folder:
        writing = _writing(Path(folder), small, large)
        reading = _reading(Path(folder), small)
    return "\n".join(
        [
            "## Bags",
            "",
            f"{COUNT} JointState of {len(small[0][1])} B, {IMAGES} images of {len(large[0][1]) / 1e3:.0f} kB; "
            "medians of 3.",
            "",
            "| writer | JointState k/s | images MB/s |",
            "|---|---|---|",
            *writing,
            "",
            "| reader | JointState k/s |",
            "|---|---|",
            *reading,
            "",
            *_recorder_load.section(SECONDS),
        ]
    )


def _load(count: int, images: int) -> Load:
    zero = np.zeros(6)
    frame = np.random.default_rng(1).integers(0, 255, (480, 640), dtype=np.uint8)
    load: Load = [
        (LEGS, to_cdr(messages.joint_state(T0 + i, topics.LEGS, zero + i, zero, zero)), T0 + i) for i in range(count)
    ]
    picture = to_cdr(messages.image(T0, "dorsal", frame))
    return load + [(IMAGE, picture, T0 + i) for i in range(images)]


def _ours(path: Path, load: Load, compression: str = "none") -> None:
    with BagWriter(path, compression=compression) as writer:
        for topic, data, t_ns in load:
            writer.write(topic, data, t_ns)


def _rosbags(path: Path, load: Load) -> None:
    with RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = load[0][0]
        connection = writer.add_connection(topic.name, topic.type, typestore=interfaces.store())
        for _, data, t_ns in load:
            writer.write(connection, t_ns, data)


def _library(path: Path, load: Load) -> None:
    path.mkdir()
    writer = McapLibraryWriter(str(path / "x.mcap"), compression=CompressionType.NONE)
    writer.start("ros2")
    topic = load[0][0]
    schema = writer.register_schema(topic.type, "ros2msg", interfaces.definition(topic.type).encode())
    channel = writer.register_channel(topic.name, "cdr", schema)
    for _, data, t_ns in load:
        writer.add_message(channel, t_ns, data, t_ns)
    writer.finish()


def _plain(path: Path, load: Load) -> None:
    with path.open("wb") as file:
        for _, data, _ in load:
            file.write(data)


def _writing(folder: Path, small: Load, large: Load) -> list[str]:
    writers: dict[str, Callable[[Path, Load], None]] = {
        "plain file": _plain,
        "**sandbot_record**": _ours,
        "**sandbot_record** lz4": lambda path, load: _ours(path, load, "lz4"),
        "**sandbot_record** zstd": lambda path, load: _ours(path, load, "zstd"),
        "mcap": _library,
        "rosbags": _rosbags,
    }
    rows = []
    for name, write in writers.items():
        rate = len(small) / _median(lambda write=write: write(_fresh(folder), small)) / 1e3
        size = sum(len(data) for _, data, _ in large) / 1e6
        speed = size / _median(lambda write=write: write(_fresh(folder), large))
        rows.append(f"| {name} | {rate:.0f} | {speed:.0f} |")
    return rows


def _reading(folder: Path, small: Load) -> list[str]:
    bag = _fresh(folder)
    _ours(bag, small)
    (file,) = bag.glob("*.mcap")

    def rosbags_raw(*, decode: bool) -> None:
        with Reader(bag) as reader:
            for connection, _, data in reader.messages():
                if decode:
                    interfaces.store().deserialize_cdr(data, connection.msgtype)

    def library(*, decode: bool) -> None:
        with file.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            for _ in reader.iter_decoded_messages() if decode else reader.iter_messages():
                pass

    readers: dict[str, Callable[[], object]] = {
        "**sandbot_record**, raw (CRCs checked)": lambda: sum(1 for _ in Bag.open(bag).messages()),
        "rosbags, raw": lambda: rosbags_raw(decode=False),
        "**sandbot_record**, in order of time as `replay` fetches them": lambda: _timeline(bag),
        "mcap, in order of time": lambda: library(decode=False),
        "**sandbot_record**, columns position, velocity, effort": lambda: Bag.open(bag).columns(
            LEGS.name, "position", "velocity", "effort"
        ),
        "**sandbot_record**, message by message": lambda: _decoded(bag),
        "rosbags, decoded": lambda: rosbags_raw(decode=True),
        "mcap-ros2-support, decoded": lambda: library(decode=True),
    }
    return [f"| {name} | {len(small) / _median(read) / 1e3:.0f} |" for name, read in readers.items()]


def quick() -> list[Ratio]:
    """Reading beside rosbags: messages per second."""
    small = _load(10_000, 0)
    with tempfile.TemporaryDirectory() as folder:
        bag = _fresh(Path(folder))
        _ours(bag, small)

        def rosbags(*, decode: bool) -> None:
            with Reader(bag) as reader:
                for connection, _, data in reader.messages():
                    if decode:
                        interfaces.store().deserialize_cdr(data, connection.msgtype)

        readers: dict[str, Callable[[], object]] = {
            "theirs": lambda: rosbags(decode=True),
            "theirs, raw": lambda: rosbags(decode=False),
            "ours": lambda: _decoded(bag),
            "ours, raw": lambda: sum(1 for _ in Bag.open(bag).messages()),
            "columns": lambda: Bag.open(bag).columns(LEGS.name, "position", "velocity", "effort"),
        }
        # In turn, so that whatever else runs slows both sides; by CPU time, so that it slows neither.
        spent: dict[str, list[float]] = {name: [] for name in readers}
        for _ in range(9):
            for name, read in readers.items():
                start = time.process_time()
                read()
                spent[name].append(time.process_time() - start)
    took = {name: statistics.median(times) for name, times in spent.items()}
    return [
        Ratio("messages decoded one by one", "rosbags", took["theirs"] / took["ours"], 1.0),
        Ratio("messages, raw", "rosbags", took["theirs, raw"] / took["ours, raw"], 1.0),
        Ratio("columns of a topic", "rosbags, decoded", took["theirs"] / took["columns"], 10.0),
    ]


def _decoded(bag: Path) -> None:
    # Not kept: a growing list would be timed, and rosbags' loop keeps nothing either.
    for message in Bag.open(bag).messages():
        message.decode()


def _timeline(bag: Path) -> None:
    timeline = Timeline(Bag.open(bag))
    for index in range(len(timeline)):
        _ = timeline[index].data


def _fresh(folder: Path) -> Path:
    path = folder / "bag"
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    return path


def _median(action: Callable[[], object], times: int = 3) -> float:
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        action()
        spent.append(time.perf_counter() - start)
    return statistics.median(spent)


if __name__ == "__main__":
    print(main())
