"""A bag is read by the definitions it carries: sensor_msgs/Range has no variance before Iron."""

import sqlite3
from pathlib import Path

import bags
import numpy as np
import pytest
import rclpy
from mcap.reader import make_reader
from mcap.records import Schema
from mcap.writer import Writer as McapLibraryWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from sandbot_common.errors import InputError
from sandbot_record.bags import interfaces, metadata
from sandbot_record.bags.interfaces import Interface
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.recover import recover
from sandbot_record.bags.translate import to_jazzy

RANGE = "sensor_msgs/msg/Range"
HEIGHTS = np.float32([0.1, 0.11, 0.12])


def ranges(release):
    """CDR messages as a release defines them."""
    types = interfaces.store(release)
    stamp = types.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    header = types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="trackway")
    more = {} if release == "humble" else {"variance": 0.0}
    given = {"header": header, "radiation_type": 0, "field_of_view": 0.1, "min_range": 0.0, "max_range": 1.0} | more
    return [bytes(types.serialize_cdr(types.types[RANGE](**given, range=one), RANGE)) for one in HEIGHTS]


def text_of(release):
    """The ros2msg definition of a release with a remark, as ROS itself writes it."""
    return b"# Single range reading.\n\n" + interfaces.store(release).generate_msgdef(RANGE, ros_version=2)[0].encode()


def idl_text():
    """Jazzy's definition as ros2idl, as a bag has it of a type that was made from IDL."""
    share = next(path for path in Path(rclpy.__file__).parents if (path / "share").is_dir()) / "share"
    parts = ["sensor_msgs/msg/Range", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"]
    texts = [(share / name).with_suffix(".idl").read_text() for name in parts]
    return "".join(f"{'=' * 80}\nIDL: {name}\n{text}" for name, text in zip(parts, texts, strict=True)).encode()


def heights(path, messages, encoding="ros2msg", text=b"", name=RANGE, **options):
    """One file of the mcap library."""
    path.mkdir()
    writer = McapLibraryWriter(str(path / f"{path.name}_0.mcap"), **options)
    writer.start("ros2")
    channel = writer.register_channel("/bed/height", "cdr", writer.register_schema(name, encoding, text))
    for index, data in enumerate(messages):
        writer.add_message(channel, bags.T0 + index, data, bags.T0 + index)
    writer.finish()
    return path


def of_sqlite3(path, release, *, version, distro):
    """A bag of rosbags whose definitions are taken out again: before Iron, sqlite3 had none."""
    with RosbagsWriter(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/bed/height", RANGE, typestore=interfaces.store(release))
        for index, data in enumerate(ranges(release)):
            writer.write(connection, bags.T0 + index, data)
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("DELETE FROM message_definitions")
    base.close()
    text = (path / "metadata.yaml").read_text().replace("version: 8", f"version: {version}")
    text = text.replace(interfaces.store(release).hash_rihs01(RANGE), "")
    (path / "metadata.yaml").write_text(text.replace("ros_distro: rosbags", f"ros_distro: '{distro}'"))
    return path


def read_heights(path):
    bag = Bag.open(path)
    decoded = [message.decode().range for message in bag.messages()]
    np.testing.assert_array_equal(decoded, HEIGHTS)
    return bag.columns("/bed/height", "range")["range"]


@pytest.mark.parametrize("release", ["humble", "jazzy"])
def test_a_file_is_read_by_its_own_definition(tmp_path, release):
    bag = heights(tmp_path / "b", ranges(release), text=text_of(release))
    np.testing.assert_array_equal(read_heights(bag), HEIGHTS)
    assert hasattr(next(Bag.open(bag).messages()).decode(), "variance") == (release == "jazzy")
    # Who hears a replay knows Jazzy's definition.
    assert bytes(Timeline(Bag.open(bag))[2].data) == ranges("jazzy")[2]


def test_what_a_message_lacks_of_jazzy_s_fields_is_empty():
    """Parts, arrays and texts too; a field of another kind is refused."""
    whole = "diagnostic_msgs/msg/DiagnosticStatus", "sensor_msgs/msg/CameraInfo", "geometry_msgs/msg/PoseWithCovariance"
    for type_name in whole:
        schema = Schema(id=1, name=type_name, encoding="ros2msg", data=b"uint8 new\n")
        data = memoryview(b"\0\1\0\0\7")
        decoded = interfaces.decode(to_jazzy(data, Interface(type_name, schema=schema)), type_name)
        assert not hasattr(decoded, "new")
    assert decoded.covariance.tolist() == [0.0] * 36
    assert decoded.pose.position.x == 0.0
    schema = Schema(id=1, name="std_msgs/msg/String", encoding="ros2msg", data=b"float64 data\n")
    with pytest.raises(InputError, match="does not fit Jazzy's definition"):
        to_jazzy(memoryview(b"\0\1\0\0" + bytes(8)), Interface("std_msgs/msg/String", schema=schema))
    # Control: what is Jazzy's already is not touched.
    assert to_jazzy(data, Interface("std_msgs/msg/UInt8")) is data


def test_a_file_of_another_release_than_it_says_is_refused(tmp_path):
    """Negative control: a definition that is not the file's own does not fit its messages."""
    bag = heights(tmp_path / "b", ranges("humble"), text=text_of("jazzy"))
    with pytest.raises(InputError, match="too short"):
        Bag.open(bag).columns("/bed/height", "range")


def test_recover_keeps_a_file_s_definition(tmp_path):
    bag = heights(tmp_path / "b", ranges("humble"), text=text_of("humble"), use_chunking=False)
    assert recover(bag, tmp_path / "r").lossless
    np.testing.assert_array_equal(read_heights(tmp_path / "r"), HEIGHTS)
    with (tmp_path / "r" / "r_0.mcap").open("rb") as file:
        (schema,) = make_reader(file).get_summary().schemas.values()
    assert (schema.name, schema.encoding, schema.data) == (RANGE, "ros2msg", text_of("humble"))
    with AnyReader([tmp_path / "r"]) as others:
        found = [others.deserialize(data, connection.msgtype).range for connection, _, data in others.messages()]
    np.testing.assert_array_equal(np.float32(found), HEIGHTS)


@pytest.mark.parametrize(("version", "distro"), [(5, ""), (4, ""), (8, "humble")])
def test_where_a_file_defines_nothing_the_release_that_wrote_it_counts(tmp_path, version, distro):
    bag = of_sqlite3(tmp_path / "b", "humble", version=version, distro=distro)
    np.testing.assert_array_equal(read_heights(bag), HEIGHTS)
    recover(bag, tmp_path / "r")
    np.testing.assert_array_equal(read_heights(tmp_path / "r"), HEIGHTS)


@pytest.mark.parametrize(("version", "distro"), [(8, ""), (8, "jazzy"), (9, "somebody")])
def test_later_releases_define_the_variance(tmp_path, version, distro):
    np.testing.assert_array_equal(
        read_heights(of_sqlite3(tmp_path / "b", "jazzy", version=version, distro=distro)), HEIGHTS
    )
    # Control: what Humble wrote is not what they read.
    with pytest.raises(InputError, match="too short"):
        Bag.open(of_sqlite3(tmp_path / "c", "humble", version=version, distro=distro)).columns("/bed/height", "range")


def test_a_type_nobody_else_knows_is_read_by_the_file_s_definition(tmp_path):
    text = b"uint32 pulse\nstd_msgs/Header header\n"  # the header is taken from Jazzy
    data = b"\0\1\0\0" + np.uint32([7, 1, 2, 1, 0]).tobytes()
    bag = heights(tmp_path / "b", [data], text=text, name="rig_msgs/msg/Pulse")
    assert Bag.open(bag).columns("/bed/height", "pulse", "header.stamp.nanosec")["pulse"].tolist() == [7]
    assert next(Bag.open(bag).messages()).decode().header.stamp.nanosec == 2
    nothing = heights(tmp_path / "c", [data], text=b"", name="rig_msgs/msg/Pulse")
    with pytest.raises(InputError, match="'rig_msgs/msg/Pulse' is not one of ROS 2 Jazzy's standard types"):
        Bag.open(nothing).columns("/bed/height", "pulse")


@pytest.mark.parametrize(
    ("encoding", "text"),
    [
        ("ros2msg", text_of("jazzy")),
        ("ros2msg", b""),
        ("ros2msg", b"no definition at all"),
        ("ros2msg", b"\xff"),
        ("", b""),
        ("ros2idl", idl_text()),
    ],
)
def test_what_says_no_other_is_jazzy_s(encoding, text):
    """Negative control: no second store where the definition is the same, or is none."""
    schema = Schema(id=1, name=RANGE, encoding=encoding, data=text)
    assert Interface(RANGE, schema=schema).types is interfaces.store()
    other = Schema(id=1, name=RANGE, encoding="ros2msg", data=text_of("humble"))
    assert Interface(RANGE, schema=other).types is not interfaces.store()


def test_an_idl_definition_is_read(tmp_path):
    text = idl_text().replace(b"float range;", b"float reach;")
    bag = heights(tmp_path / "b", ranges("jazzy"), "ros2idl", text)
    np.testing.assert_array_equal(Bag.open(bag).columns("/bed/height", "reach")["reach"], HEIGHTS)


def test_a_flipped_bit_in_a_definition_does_not_count_where_the_hash_is_jazzy_s(tmp_path):
    spoilt = Schema(id=1, name=RANGE, encoding="ros2msg", data=text_of("jazzy").replace(b"range", b"rangd"))
    given = Interface(RANGE, hash=interfaces.type_hash(RANGE), schema=spoilt)
    assert given.types is interfaces.store()
    assert given.described().schema.data.decode() == interfaces.definition(RANGE)
    # Control: without that hash, the file is believed.
    assert Interface(RANGE, schema=spoilt).described().schema is spoilt


@pytest.mark.parametrize("options", [{"repeat_schemas": False}, {"repeat_channels": False}, {}])
def test_a_summary_may_leave_the_schemas_out(tmp_path, options):
    bag = heights(tmp_path / "b", ranges("jazzy"), text=text_of("jazzy"), **options)
    assert Bag.open(bag).topics["/bed/height"].type == RANGE
    np.testing.assert_array_equal(read_heights(bag), HEIGHTS)


def test_the_release_is_told_by_name_or_by_version():
    assert metadata.BagInfo(distro="humble").release == "humble"
    assert [metadata.BagInfo(distro="", version=one).release for one in (4, 6, 7, 8, 9)] == [
        *["humble"] * 2, *["iron"] * 2, "jazzy"
    ]  # fmt: skip
