import os
from pathlib import Path

import bags
import pytest
import yaml
from mcap.reader import NonSeekingReader, make_reader
from rosbags.rosbag2 import Reader

from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_record.bags import metadata
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import BagWriter, Split


def mcap_messages(bag: Path) -> list[tuple[str, int, bytes]]:
    found = []
    for file in sorted(bag.glob("*.mcap")):
        with file.open("rb") as stream:
            found += [
                (c.topic, m.log_time, m.data) for _, c, m in make_reader(stream, validate_crcs=True).iter_messages()
            ]
        with file.open("rb") as stream:  # the other reader checks the data section and every record in order
            assert sum(1 for _ in NonSeekingReader(stream, validate_crcs=True).iter_messages()) > 0
    return found


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_rosbags_and_mcap_read_what_was_written(tmp_path, compression):
    bag = bags.legs_bag(tmp_path / "b", compression=compression, chunk_size=20_000)
    expected = [
        ("/leg_states", bags.T0 + i * 1_000_000, bags.joint_state(i, bags.T0 + i * 1_000_000)) for i in range(500)
    ]
    assert mcap_messages(bag) == expected
    with Reader(bag) as reader:
        assert [(c.topic, t, bytes(d)) for c, t, d in reader.messages()] == expected
        (connection,) = reader.connections
        assert connection.msgcount == reader.message_count == 500
        assert connection.ext.offered_qos_profiles == [metadata.qos(depth=topics.LEG_STATES.depth)]


def test_metadata_yaml_is_that_of_rosbag2(tmp_path):
    bag = bags.legs_bag(tmp_path / "b")
    content = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert content["version"] == 9
    assert content["storage_identifier"] == "mcap"
    assert content["message_count"] == 500
    assert content["duration"]["nanoseconds"] == 499_000_000
    assert content["starting_time"]["nanoseconds_since_epoch"] == bags.T0
    assert content["relative_file_paths"] == ["b_0.mcap"]
    (topic,) = content["topics_with_message_count"]
    assert topic["topic_metadata"]["type_description_hash"] == (
        # The hash ROS 2 Jazzy itself shows for sensor_msgs/msg/JointState.
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    )
    assert topic["topic_metadata"]["offered_qos_profiles"][0]["reliability"] == "reliable"


@pytest.mark.parametrize("whole", [True, False])
def test_a_closed_bag_outlives_a_power_cut(tmp_path, monkeypatch, whole):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda handle: synced.append(Path(os.readlink(f"/proc/self/fd/{handle}"))))
    with BagWriter(tmp_path / "b", whole=whole) as writer:
        folder = writer.folder
    assert set(synced[:2]) == {folder / "metadata.yaml", folder / "b_0.mcap"}
    assert synced[2:] == [folder, *([tmp_path] if whole else [])]


def test_latched_topics_say_so(tmp_path):
    bag = bags.trial_bag(tmp_path / "b")
    with Reader(bag) as reader:
        durability = {c.topic: c.ext.offered_qos_profiles[0].durability.name for c in reader.connections}
    assert durability["/trial"] == "TRANSIENT_LOCAL"
    assert durability["/leg_states"] == "VOLATILE"


def test_an_existing_bag_is_not_overwritten(tmp_path):
    bag = bags.legs_bag(tmp_path / "b", 3)
    before = (bag / "b_0.mcap").read_bytes()
    with pytest.raises(InputError, match="exists already"):
        BagWriter(bag)
    assert (bag / "b_0.mcap").read_bytes() == before


def test_an_interrupted_whole_bag_leaves_nothing(tmp_path):
    def interrupted():
        with BagWriter(tmp_path / "b") as writer:
            writer.write(topics.LEG_STATES, bags.joint_state(0, 0), 1)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_live_bag_is_left_to_recover(tmp_path):
    writer = BagWriter(tmp_path / "b", whole=False)
    writer.write(topics.LEG_STATES, bags.joint_state(0, 0), 1)
    writer.flush()
    writer.abandon()
    assert Bag.open(tmp_path / "b", strict=False).count == 1


def test_flushed_by_log_time(tmp_path):
    writer = BagWriter(tmp_path / "b", whole=False, flush_period_s=1.0)
    for second in range(4):
        writer.write(topics.LEG_STATES, bags.joint_state(0, 0), bags.T0 + second * 1_000_000_000)
    # Without close: what is in the file now is what a killed process leaves.
    assert Bag.open(tmp_path / "b", strict=False).count == 3
    writer.close()


@pytest.mark.parametrize("split", [Split(size=50_000), Split(seconds=0.1)])
def test_split(tmp_path, split):
    bag = bags.legs_bag(tmp_path / "b", split=split, chunk_size=5000)
    assert len(list(bag.glob("*.mcap"))) >= 3
    with Reader(bag) as reader:
        assert sum(1 for _ in reader.messages()) == reader.message_count == 500
    assert Bag.open(bag).columns("/leg_states", "position")["position"][:, 0].tolist() == list(range(500))


def test_refuses(tmp_path):
    with BagWriter(tmp_path / "b") as writer:
        with pytest.raises(InputError, match="was not added"):
            writer.write("/nobody", b"", 0)
        with pytest.raises(InputError, match="not one of ROS 2"):
            writer.add_topic("/x", "my_msgs/msg/Thing")
        writer.add_topic("/x", "std_msgs/msg/String")
        with pytest.raises(InputError, match="has type std_msgs/msg/String"):
            writer.add_topic("/x", "std_msgs/msg/Float64")
        with pytest.raises(InputError, match="log time -1"):
            writer.write("/x", b"", -1)
    with pytest.raises(InputError, match="compression 'gzip'"):
        BagWriter(tmp_path / "c", compression="gzip")
    assert not (tmp_path / "c").exists()


def test_a_custom_type_with_its_definition(tmp_path):
    with BagWriter(tmp_path / "b") as writer:
        writer.add_topic("/x", "my_msgs/msg/Thing", definition="int32 x\n", type_hash="RIHS01_" + "0" * 64)
        writer.write("/x", b"\0\1\0\0\5\0\0\0", 5)
    with Reader(tmp_path / "b") as reader:
        assert [(c.msgtype, t) for c, t, _ in reader.messages()] == [("my_msgs/msg/Thing", 5)]


def test_short_writes_are_continued(tmp_path, monkeypatch):
    real = os.writev
    monkeypatch.setattr(os, "writev", lambda fd, parts: real(fd, [memoryview(b"".join(parts))[:1000]]))
    bag = bags.legs_bag(tmp_path / "b", 200)
    assert len(mcap_messages(bag)) == 200


def test_a_name_that_cannot_stand_in_metadata_yaml_is_refused_before_anything_is_made(tmp_path):
    name = os.fsdecode(b"y\xff")
    with pytest.raises(InputError, match=r"y\\udcff': not UTF-8"):
        BagWriter(tmp_path / name, whole=False)
    assert not list(tmp_path.iterdir())
