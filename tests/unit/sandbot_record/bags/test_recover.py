"""What recover writes is what it was given, and what it could not find is told."""

import json
import shutil
import struct

import bags
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapLibraryWriter

from sandbot_common.errors import InputError
from sandbot_record.bags import interfaces
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.recover import recover
from sandbot_record.tools import info
from sandbot_record.tools import recover as tool

TYPE = "sensor_msgs/msg/JointState"
COUNT = 40
ENCODINGS = {
    "json": (
        "foxglove.Value",
        "jsonschema",
        b'{"type": "object"}',
        [json.dumps({"data": i}).encode() for i in range(3)],
    ),
    "ros1": ("std_msgs/Float64", "ros1msg", b"float64 data", [struct.pack("<d", i) for i in range(3)]),
    "protobuf": ("rig.Value", "protobuf", b"\xff\xfe\0", [b"\x08\x01", b"", b"\x08\x02"]),
}


def in_encoding(path, encoding):
    name, schema_encoding, text, messages = ENCODINGS[encoding]
    writer = McapLibraryWriter(str(path))
    writer.start(encoding)
    channel = writer.register_channel("/value", encoding, writer.register_schema(name, schema_encoding, text))
    bare = writer.register_channel("/bare", encoding, 0)
    for index, data in enumerate(messages):
        writer.add_message(channel, bags.T0 + index, data, bags.T0 + index)
        writer.add_message(bare, bags.T0 + index, data, bags.T0 + index)
    writer.finish()
    return path


def content(file):
    """Of a file, by the reader of others: what each channel says of its messages, and the messages."""
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        schemas = reader.get_summary().schemas
        about = {
            one.topic: (one.message_encoding, *told(schemas.get(one.schema_id)))
            for one in reader.get_summary().channels.values()
        }
        return about, [(channel.topic, message.data) for _, channel, message in reader.iter_messages()]


def told(schema):
    return (schema.name, schema.encoding, schema.data) if schema else ()


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_what_is_not_cdr_comes_through_under_its_name(tmp_path, encoding, capsys):
    source = in_encoding(tmp_path / "b.mcap", encoding)
    assert recover(source, tmp_path / "r").lossless
    again = tmp_path / "r" / "r_0.mcap"
    assert content(again) == content(source)
    assert content(again)[0]["/value"] == (encoding, *ENCODINGS[encoding][:3])
    with again.open("rb") as stream:
        assert make_reader(stream).get_header().profile == ""
    assert info.main([str(tmp_path / "r")]) == 0
    assert f"Serialization Format: {encoding}" in capsys.readouterr().out


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_what_is_not_cdr_is_not_decoded(tmp_path, encoding):
    bag = Bag.open(in_encoding(tmp_path / "b.mcap", encoding))
    complaint = f"messages are encoded as '{encoding}'; only cdr can be decoded"
    with pytest.raises(InputError, match=f"topic /value: {complaint}"):
        bag.columns("/value", "data")
    with pytest.raises(InputError, match=complaint):
        next(bag.messages()).decode()
    with pytest.raises(InputError, match=f"topic /value: {complaint}; leave it out with --topics"):
        Timeline(bag)


def test_cdr_is_written_as_ros_2_asks(tmp_path):
    """Negative control."""
    recover(bags.legs_bag(tmp_path / "b", 3), tmp_path / "r")
    with (tmp_path / "r" / "r_0.mcap").open("rb") as stream:
        assert make_reader(stream).get_header().profile == "ros2"
    assert content(tmp_path / "r" / "r_0.mcap") == content(tmp_path / "b" / "b_0.mcap")


WITHOUT_CRC = {
    "unchunked": {"use_chunking": False},
    "no crc": {"enable_crcs": False, "compression": CompressionType.NONE},
}


def legs(path, **options):
    writer = McapLibraryWriter(str(path), **options)
    writer.start("ros2")
    schema = writer.register_schema(TYPE, "ros2msg", interfaces.definition(TYPE).encode())
    channel = writer.register_channel("/leg_states", "cdr", schema)
    for index in range(COUNT):
        writer.add_message(channel, bags.T0 + index, bags.joint_state(index, index), bags.T0 + index)
    writer.finish()
    return path


@pytest.mark.parametrize("kind", WITHOUT_CRC)
@pytest.mark.parametrize("bit", range(8))
def test_a_message_that_a_flipped_bit_makes_another_record_is_missed(tmp_path, kind, bit):
    file = legs(tmp_path / "b.mcap", **WITHOUT_CRC[kind])
    assert recover(file, tmp_path / "whole").lossless  # negative control
    data = bytearray(file.read_bytes())
    at = bytes(data).index(bags.joint_state(20, 20)) - 31
    assert data[at] == Opcode.MESSAGE
    data[at] ^= 1 << bit
    file.write_bytes(data)
    with pytest.raises(InputError, match="recover"):
        Bag.open(file)
    result = recover(file, tmp_path / "r")
    assert sum(result.counts.values()) < COUNT
    assert not result.lossless
    if bit == 1:
        assert result.notes == [f"b.mcap: its summary says {COUNT} messages, it holds {COUNT - 1}"]
        with pytest.raises(InputError, match=f"b.mcap: its summary says {COUNT} messages, it holds {COUNT - 1}"):
            Bag.open(file)


def test_a_message_is_missed_in_a_bag_that_was_cut_off_elsewhere(tmp_path):
    """One file was closed, the next was not: the first still says how many messages it had."""
    (tmp_path / "b").mkdir()
    file = legs(tmp_path / "b" / "b_0.mcap", use_chunking=False)
    shutil.copy(file, tmp_path / "b" / "b_1.mcap")
    torn = tmp_path / "b" / "b_1.mcap"
    torn.write_bytes(torn.read_bytes()[:-200])
    assert len(recover(tmp_path / "b", tmp_path / "whole").notes) == 1  # negative control: the cut alone
    data = bytearray(file.read_bytes())
    data[bytes(data).index(bags.joint_state(20, 20)) - 31] ^= 2
    file.write_bytes(data)
    told = f"b_0.mcap: its summary says {COUNT} messages, it holds {COUNT - 1}"
    assert told in recover(tmp_path / "b", tmp_path / "r").notes


@pytest.mark.parametrize(("count", "said"), [(1, "1 message"), (2, "2 messages")])
def test_messages_are_counted_in_words(tmp_path, capsys, count, said):
    file = bags.legs_bag(tmp_path / "b", count) / "b_0.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    assert tool.main([str(tmp_path / "b"), str(tmp_path / "r")]) == 0
    assert f": {said} back\n" in (printed := capsys.readouterr().out)
    assert printed.endswith(f"r: {said}, complete\n")


def test_fewer_messages_than_metadata_yaml_says_are_lost(tmp_path):
    """Where a file has no statistics, the bag's metadata.yaml still knows."""
    bag = bags.legs_bag(tmp_path / "b", 3)
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text.replace("message_count: 3", "message_count: 4"))
    assert recover(bag, tmp_path / "r").notes == ["metadata.yaml says 4 messages, the files hold 3"]
