import shutil

import bags
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapLibraryWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.serialization import to_cdr
from sandbot_record.bags import interfaces, mcap_scan, metadata
from sandbot_record.bags.reader import FIELD_STAMP, Bag, is_bag
from sandbot_record.bags.recording import Limits
from sandbot_record.bags.writer import BagWriter, Split

TYPE = "sensor_msgs/msg/JointState"


def test_raw_messages(tmp_path):
    bag = Bag.open(bags.trial_bag(tmp_path / "b"))
    assert bag.complete
    assert not bag.problems
    assert bag.count == sum(1 for _ in bag.messages())
    (trial,) = bag.messages(["/trial"])
    assert "t0001" in trial.decode().data
    assert bag.provenance["trial"]["exit_status"] == "ok"


def test_times_and_sequence(tmp_path):
    bag = Bag.open(bags.legs_bag(tmp_path / "b", 3))
    assert [(m.log_time_ns - bags.T0, m.log_time_ns - m.publish_time_ns, m.sequence) for m in bag.messages()] == [
        (0, 7, 1),
        (1_000_000, 7, 2),
        (2_000_000, 7, 3),
    ]
    assert (bag.start_ns, bag.end_ns) == (bags.T0, bags.T0 + 2_000_000)


def test_columns(tmp_path):
    bag = Bag.open(bags.legs_bag(tmp_path / "b", chunk_size=9_000))
    legs = bag.columns("/leg_states", "position", "velocity", *FIELD_STAMP)
    expected = np.arange(500)[:, None] + np.arange(6) / 8
    np.testing.assert_array_equal(legs["position"], expected)
    np.testing.assert_array_equal(legs["velocity"], -expected)
    np.testing.assert_array_equal(legs.stamp_ns, bags.T0 + np.arange(500) * 1_000_000)


def test_columns_where_layouts_differ(tmp_path):
    """Another frame name moves the fields: such messages form a group of their own."""
    with BagWriter(tmp_path / "b") as writer:
        for i in range(60):
            point = messages.point(i, (i, 2.0 * i, 3.0 * i))
            point.header.frame_id = "abcdefg"[: i % 7]
            writer.write(topics.COM, to_cdr(point), i + 1)
    columns = Bag.open(tmp_path / "b").columns("/landmarks/com", "point.y")
    np.testing.assert_array_equal(columns["point.y"], 2.0 * np.arange(60))


def test_columns_come_in_order_of_time(tmp_path):
    with BagWriter(tmp_path / "b", flush_period_s=0) as writer:
        for i in (5, 3, 4, 1, 2):
            writer.write(topics.SPEED_MEAN, to_cdr(messages.float64(i)), i)
    assert Bag.open(tmp_path / "b").columns("/speed/mean", "data")["data"].tolist() == [1, 2, 3, 4, 5]


def test_columns_refuse(tmp_path):
    with BagWriter(tmp_path / "b") as writer:
        writer.write(topics.COM, to_cdr(messages.point(1, (0, 0, 0))), 1)
        writer.write(topics.SPEED_MEAN, b"\0\1\0\0", 2)
        writer.write(topics.LIFT, b"\7\1\0\0\0\0\0\0", 2)
        for i, n in enumerate((2, 3)):
            writer.write(topics.LEG_STATES, bags.joint_state(0, i, topics.LEGS[:n]), i)
    bag = Bag.open(tmp_path / "b")
    with pytest.raises(InputError, match="no topic /none; there are: /landmarks/com"):
        bag.columns("/none", "data")
    with pytest.raises(InputError, match=r"no numeric field 'point.w'; there are: .*point.x"):
        bag.columns("/landmarks/com", "point.w")
    with pytest.raises(InputError, match="/speed/mean: 4 bytes are too short"):
        bag.columns("/speed/mean", "data")
    with pytest.raises(InputError, match=r"/lift: .*no plain CDR"):
        bag.columns("/lift", "data")
    with pytest.raises(InputError, match="position does not have the same number of values"):
        bag.columns("/leg_states", "position")


USED_TYPES = sorted({topic.type for topic in topics.ALL})


@st.composite
def random_message(draw, type_name):
    """A message of any type with random content, built along its definition."""
    from rosbags.interfaces import Nodetype

    store = interfaces.store()

    def base(name):
        if name == "string":
            return draw(st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=8))
        if name == "bool":
            return draw(st.booleans())
        if name in ("float32", "float64"):
            return draw(st.floats(width=32))
        if name in ("byte", "octet"):
            return draw(st.integers(0, 127))  # rosbags writes these as signed
        bits = int("".join(filter(str.isdigit, name)) or 8)
        low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if name.startswith("int") else (0, 2**bits - 1)
        return draw(st.integers(low, high))

    def value(description):
        kind, detail = description
        if kind == Nodetype.BASE:
            return base(detail[0])
        if kind == Nodetype.NAME:
            return message(detail)
        element, bound = detail
        count = bound if kind == Nodetype.ARRAY else draw(st.integers(0, 3))
        items = [value(element) for _ in range(count)]
        numeric = element[0] == Nodetype.BASE and element[1][0] != "string"
        if numeric:
            name = element[1][0]
            return np.array(items, dtype={"bool": "?", "byte": "u1", "char": "u1", "octet": "u1"}.get(name, name))
        return items

    def message(name):
        fields = {field: value(description) for field, description in store.fielddefs[name][1]}
        return store.types[name](**fields)

    return message(type_name)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), type_name=st.sampled_from(USED_TYPES), compression=st.sampled_from(["none", "lz4", "zstd"]))
def test_write_then_read_is_equal(tmp_path, data, type_name, compression):
    shutil.rmtree(tmp_path / "b", ignore_errors=True)
    payloads = [bags.serialize(data.draw(random_message(type_name)), type_name) for _ in range(3)]
    times = data.draw(st.lists(st.integers(0, 2**62), min_size=3, max_size=3))
    with BagWriter(tmp_path / "b", compression=compression, flush_period_s=0) as writer:
        writer.add_topic("/x", type_name)
        for payload, time in zip(payloads, times, strict=True):
            writer.write("/x", payload, time, 5)
    found = list(Bag.open(tmp_path / "b").messages())
    assert [(bytes(m.data), m.log_time_ns, m.publish_time_ns) for m in found] == [
        (payload, time, 5) for payload, time in zip(payloads, times, strict=True)
    ]
    for message in found:
        assert bags.serialize(message.decode(), type_name) == bytes(message.data)


def fill_mcap(path, **options):
    """A file as the mcap library writes it."""
    writer = McapLibraryWriter(str(path), **options)
    writer.start("ros2")
    schema = writer.register_schema(TYPE, "ros2msg", interfaces.definition(TYPE).encode())
    channel = writer.register_channel("/leg_states", "cdr", schema)
    for i in range(300):
        t_ns = bags.T0 + i * 1_000_000
        writer.add_message(channel, t_ns, bags.joint_state(i, t_ns), t_ns)
    writer.finish()


MCAP_OPTIONS = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 5000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 5000},
    "none": {"compression": CompressionType.NONE},
    "unchunked": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE, "compression": CompressionType.LZ4},
    "no summary": {
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
    "no crc": {"enable_crcs": False, "compression": CompressionType.NONE},
}


@pytest.mark.parametrize("kind", MCAP_OPTIONS)
@pytest.mark.parametrize("as_folder", [True, False])
def test_mcap_of_others_without_metadata_yaml(tmp_path, kind, as_folder):
    fill_mcap(tmp_path / "some.mcap", **MCAP_OPTIONS[kind])
    bag = Bag.open(tmp_path if as_folder else tmp_path / "some.mcap")
    assert bag.topics["/leg_states"].type == TYPE
    np.testing.assert_array_equal(bag.columns("/leg_states", "position")["position"][:, 0], np.arange(300))


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("mode", list(CompressionMode))
@pytest.mark.parametrize("version", [8, 9])
def test_bags_of_rosbags(tmp_path, storage, mode, version):
    writer = RosbagsWriter(tmp_path / "b", version=version, storage_plugin=storage)
    if storage == StoragePlugin.SQLITE3 and mode == CompressionMode.STORAGE:
        pytest.skip("sqlite3 has no compression of its own")
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/leg_states", TYPE, typestore=interfaces.store())
        for i in range(2500):
            writer.write(connection, bags.T0 + i, bags.joint_state(i, i))
    bag = Bag.open(tmp_path / "b")
    assert bag.count == 2500
    np.testing.assert_array_equal(bag.columns("/leg_states", "position")["position"][:, 0], np.arange(2500))


def test_no_bag(tmp_path):
    with pytest.raises(InputError, match="no such bag"):
        Bag.open(tmp_path / "none")
    with pytest.raises(InputError, match=r"not a bag: no metadata.yaml"):
        Bag.open(tmp_path)
    (tmp_path / "trials").mkdir()
    with pytest.raises(InputError, match=r"not a bag but a campaign folder: its bags are in .*/trials"):
        Bag.open(tmp_path)
    (tmp_path / "x.txt").write_text("x")
    with pytest.raises(InputError, match="not a bag: neither"):
        Bag.open(tmp_path / "x.txt")
    (tmp_path / "x.db3").write_bytes(b"not sqlite")
    with pytest.raises(InputError, match=r"rosbags can't read x.db3"):
        Bag.open(tmp_path / "x.db3")


def folder_of(folder, *names):
    """A file of 300 joint states under each name, without metadata.yaml."""
    folder.mkdir()
    for name in names:
        fill_mcap(folder / name)
    return folder


@pytest.mark.parametrize(
    ("names", "count"),
    [
        (["b_0.mcap", "b_1.mcap", "b_10.mcap", "._b_0.mcap"], 900),
        (["b_1.mcap"], 300),
        (["monday.mcap", "tuesday.mcap"], None),
        (["t0001.mcap", "t0002.mcap"], None),
        (["a_0.mcap", "b_0.mcap"], None),
        (["b_0.mcap", "copy.mcap"], None),
        # Splits are numbered from 0: these are trials.
        (["trial_1.mcap", "trial_2.mcap"], None),
    ],
)
def test_files_without_metadata_yaml_are_one_bag_only_as_its_splits(tmp_path, names, count):
    folder = folder_of(tmp_path / "f", *names)
    assert is_bag(folder) == (count is not None)
    if count:
        assert Bag.open(folder).count == count
        return
    with pytest.raises(InputError, match=r"not one bag but a folder of several, .*\.mcap and .*\.mcap"):
        Bag.open(folder)
    assert Bag.open(folder / names[0]).count == 300


@pytest.mark.parametrize("name", ["backup.mcap", "b_7.mcap", "other_1.mcap"])
def test_a_file_that_a_complete_bag_does_not_name_is_none_of_its(tmp_path, name):
    bag = bags.legs_bag(tmp_path / "b", 500, split=Split(size=50_000), chunk_size=5000)
    shutil.copy(bag / "b_0.mcap", bag / name)
    assert Bag.open(bag).count == 500


@pytest.mark.parametrize(("name", "taken"), [("b_1.mcap", True), ("b_0 copy.mcap", False), ("c_1.mcap", False)])
def test_a_recording_that_was_cut_off_has_its_later_splits(tmp_path, name, taken):
    """Those its last metadata.yaml does not name yet; no other file."""
    writer = BagWriter(tmp_path / "b", whole=False)
    writer.write(topics.COM, to_cdr(messages.point(1, (0, 0, 0))), 1)
    writer.flush()
    writer.abandon()
    fill_mcap(tmp_path / "b" / name)
    assert Bag.open(tmp_path / "b", strict=False).count == (301 if taken else 1)


def test_metadata_yaml_that_names_a_missing_file(tmp_path):
    bag = bags.legs_bag(tmp_path / "b", 3)
    (bag / "b_0.mcap").unlink()
    with pytest.raises(InputError, match=r"b_0\.mcap, named in metadata\.yaml, is missing"):
        Bag.open(bag)


def test_an_unfinished_bag_names_recover(tmp_path):
    bag = bags.legs_bag(tmp_path / "b")
    file = bag / "b_0.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"unfinished.*trackway recover"):
        Bag.open(bag)
    assert not Bag.open(bag, strict=False).complete


def test_a_file_of_random_bytes_was_not_cut_off(tmp_path):
    """An empty one, or one of a few of the format's first bytes, may have been."""
    bag = bags.legs_bag(tmp_path / "b", 3)
    file = bag / "b_0.mcap"
    start = file.read_bytes()[:4]
    file.write_bytes(bytes(range(256)) * 10)
    said = r"b_0\.mcap neither begins nor ends as an MCAP file; no message can be brought back$"
    with pytest.raises(InputError, match=said):
        Bag.open(bag)
    for short in (b"", start):
        file.write_bytes(short)
        assert Bag.open(bag, strict=False).problems[0] == "b_0.mcap is unfinished, its recording was cut off"


def test_fewer_messages_than_metadata_yaml_says(tmp_path):
    bag = bags.legs_bag(tmp_path / "b", 3)
    text = (bag / "metadata.yaml").read_text().replace("message_count: 3", "message_count: 4")
    (bag / "metadata.yaml").write_text(text)
    with pytest.raises(InputError, match="says 4 messages, the files hold 3"):
        Bag.open(bag)


def test_a_metadata_yaml_that_names_no_file_is_no_bag(tmp_path):
    metadata.write(tmp_path, metadata.BagInfo())
    with pytest.raises(InputError, match="names no storage file"):
        Bag.open(tmp_path)


@pytest.mark.parametrize(("compression", "read"), [("none", 40), ("zstd", 0)])
def test_only_what_is_compressed_has_a_limit(tmp_path, monkeypatch, compression, read):
    monkeypatch.setattr(mcap_scan, "CHUNK_LIMIT", 5000)
    bag = bags.legs_bag(tmp_path / "b", 40, compression=compression)
    (file,) = bag.glob("*.mcap")
    found = mcap_scan.scan(memoryview(file.read_bytes()))
    assert sum(len(one.rows) for one in found if isinstance(one, mcap_scan.Batch)) == read


def test_what_the_recorder_takes_is_within_the_limit():
    assert Limits().queue_bytes < mcap_scan.CHUNK_LIMIT - (1 << 20)
