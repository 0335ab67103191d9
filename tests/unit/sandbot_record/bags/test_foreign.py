"""Whatever wrote the bag of a trial: `table` makes the same row of it and `replay` plays the same messages."""

import bags
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapLibraryWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from sandbot_common.errors import InputError
from sandbot_record.bags import interfaces
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.tools import replay
from sandbot_record.trials import from_bags as table


def of_rosbags(path, messages, storage, mode):
    writer = RosbagsWriter(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    connections = {}
    with writer:
        for one in messages:
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(one.topic, one.type, typestore=interfaces.store())
            writer.write(connections[one.topic], one.log_time_ns, bytes(one.data))
    return path


def of_mcap(path, messages, **options):
    """One file of the mcap library, without metadata.yaml."""
    path.mkdir()
    writer = McapLibraryWriter(str(path / "some.mcap"), **options)
    writer.start("ros2")
    channels = {}
    for one in messages:
        if one.topic not in channels:
            schema = writer.register_schema(one.type, "ros2msg", interfaces.definition(one.type).encode())
            channels[one.topic] = writer.register_channel(one.topic, "cdr", schema)
        writer.add_message(channels[one.topic], one.log_time_ns, bytes(one.data), one.publish_time_ns)
    writer.finish()
    return path


WRITERS = {
    "sqlite3": lambda path, found: of_rosbags(path, found, StoragePlugin.SQLITE3, CompressionMode.NONE),
    "sqlite3, messages zstd": lambda path, found: of_rosbags(
        path, found, StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    ),
    "rosbags mcap": lambda path, found: of_rosbags(path, found, StoragePlugin.MCAP, CompressionMode.NONE),
    "rosbags mcap, messages zstd": lambda path, found: of_rosbags(
        path, found, StoragePlugin.MCAP, CompressionMode.MESSAGE
    ),
    "mcap zstd": lambda path, found: of_mcap(path, found, compression=CompressionType.ZSTD, chunk_size=9000),
    "mcap lz4": lambda path, found: of_mcap(path, found, compression=CompressionType.LZ4, chunk_size=9000),
    "mcap unchunked": lambda path, found: of_mcap(path, found, use_chunking=False),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_table_and_replay_read_what_others_wrote(tmp_path, kind):
    own = bags.trial_bag(tmp_path / "own")
    found = list(Bag.open(own).messages())
    other = WRITERS[kind](tmp_path / "other", found)
    assert table.row_from_bag(other) == table.row_from_bag(own)
    ours, theirs = Timeline(Bag.open(own)), Timeline(Bag.open(other))
    assert len(theirs) == len(ours)
    for index in range(0, len(ours), 37):
        one, two = ours[index], theirs[index]
        assert (one.topic, one.type, one.log_time_ns) == (two.topic, two.type, two.log_time_ns)
        assert bytes(one.data) == bytes(two.data)


def test_what_rosbags_cannot_read_is_refused_in_a_line_that_says_why(tmp_path, capsys):
    """An older sqlite3 bag without metadata.yaml, and one whose storage is unknown to everybody."""
    bag = WRITERS["sqlite3"](tmp_path / "b", list(Bag.open(bags.trial_bag(tmp_path / "own")).messages())[:5])
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text.replace("storage_identifier: sqlite3", "storage_identifier: tape"))
    assert replay.main([str(bag)]) == 2
    complaint = capsys.readouterr().err
    assert "rosbags can't read" in complaint
    assert complaint.count("\n") == 1
    (bag / "metadata.yaml").unlink()
    with pytest.raises(InputError, match=r"rosbags can't read .*\.db3"):
        table.row_from_bag(bag)
