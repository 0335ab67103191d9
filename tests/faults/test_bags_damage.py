"""A damaged bag gives back everything but the damaged chunk; anything at all gives a bag or one line."""

import random
import resource
import shutil
import time
from pathlib import Path

import bags
import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapLibraryWriter
from rosbags.rosbag2 import Reader

from sandbot_common.errors import InputError
from sandbot_record.bags import interfaces, mcap_scan, metadata
from sandbot_record.bags.file_bytes import FileBytes
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.recover import recover
from sandbot_record.trials import from_bags as table

pytestmark = pytest.mark.slow  # together seconds

COUNT = 500
CHUNK = 9_000
KINDS = ("none", "lz4", "zstd")


def opens_everywhere(bag: Path) -> list[int]:
    """Read with our reader, rosbags' strict one and mcap's with CRCs; the indices of the joint states in it."""
    (file,) = bag.glob("*.mcap")
    with Reader(bag) as reader:
        store = interfaces.store()
        found = [int(store.deserialize_cdr(d, c.msgtype).position[0]) for c, _, d in reader.messages()]
        assert len(found) == reader.message_count
    with file.open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == len(found)
    with file.open("rb") as stream:
        assert sum(1 for _ in NonSeekingReader(stream, validate_crcs=True).iter_messages()) == len(found)
    assert Bag.open(bag).columns("/leg_states", "position")["position"][:, 0].tolist() == found
    return found


def chunks_of(file: Path) -> list[tuple[int, range]]:
    """Offset of each chunk and the joint states in it."""
    found, first = [], 0
    for item in mcap_scan.scan(FileBytes(file)):
        if isinstance(item, mcap_scan.Batch):
            found.append((item.offset, range(first, first + len(item.rows))))
            first += len(item.rows)
    return found


def flip(file: Path, at: int, bit: int = 0) -> None:
    content = bytearray(file.read_bytes())
    content[at] ^= 1 << bit
    file.write_bytes(content)


@pytest.mark.parametrize("compression", KINDS)
def test_a_flipped_byte_costs_its_chunk_only(tmp_path, compression):
    whole = bags.legs_bag(tmp_path / "whole", COUNT, chunk_size=CHUNK, compression=compression)
    chunks = chunks_of(whole / "whole_0.mcap")
    assert len(chunks) > 10
    draw = random.Random(1)
    for number, (offset, inside) in enumerate(chunks):
        bag = shutil.copytree(whole, tmp_path / f"d{number}")
        length = int.from_bytes((whole / "whole_0.mcap").read_bytes()[offset + 1 : offset + 9], "little")
        flip(bag / "whole_0.mcap", offset + 9 + draw.randrange(length), draw.randrange(8))
        result = recover(bag, tmp_path / f"r{number}")
        found = opens_everywhere(tmp_path / f"r{number}")
        lost = sorted(set(range(COUNT)) - set(found))
        # A flip in the chunk's own times hurts nothing: they are not used and are written anew.
        assert lost in ([], list(inside)), number
        if lost and result.losses:
            assert result.losses["/leg_states"].count == len(lost)
        assert lost == [] or not result.lossless
        if lost:
            with pytest.raises(InputError, match="recover"):
                Bag.open(bag)


@pytest.mark.parametrize("compression", KINDS)
def test_a_chunk_damaged_in_its_data_is_named_with_its_topic_and_times(tmp_path, compression):
    bag = bags.legs_bag(tmp_path / "b", COUNT, chunk_size=CHUNK, compression=compression)
    offset, inside = chunks_of(bag / "b_0.mcap")[0]
    content = bytearray((bag / "b_0.mcap").read_bytes())
    content[offset + 200 : offset + 240] = b"\xff" * 40  # one bit may leave an lz4 match as good as it was
    (bag / "b_0.mcap").write_bytes(content)
    loss = recover(bag, tmp_path / "r").losses["/leg_states"]
    assert loss.count == len(inside)
    assert (loss.first_ns, loss.last_ns) == (bags.T0, bags.T0 + inside[-1] * 1_000_000)


def test_nothing_is_lost_from_a_whole_bag(tmp_path):
    """Negative control."""
    bag = bags.legs_bag(tmp_path / "b", COUNT, chunk_size=CHUNK)
    result = recover(bag, tmp_path / "r")
    assert result.lossless
    assert opens_everywhere(tmp_path / "r") == list(range(COUNT))


def test_cut_anywhere(tmp_path):
    whole = bags.legs_bag(tmp_path / "whole", COUNT, chunk_size=CHUNK)
    content = (whole / "whole_0.mcap").read_bytes()
    chunks = chunks_of(whole / "whole_0.mcap")
    draw = random.Random(2)
    cuts = [draw.randrange(chunks[1][0], len(content)) for _ in range(30)]
    for number, cut in enumerate(cuts):
        bag = shutil.copytree(whole, tmp_path / f"d{number}")
        (bag / "whole_0.mcap").write_bytes(content[:cut])
        recover(bag, tmp_path / f"r{number}")
        found = opens_everywhere(tmp_path / f"r{number}")
        expected = max(inside[-1] + 1 for offset, inside in chunks if _end(content, offset) <= cut)
        assert found == list(range(expected))


def _end(content: bytes, offset: int) -> int:
    return offset + 9 + int.from_bytes(content[offset + 1 : offset + 9], "little")


def test_without_metadata_yaml_and_with_the_beginning_gone(tmp_path):
    bag = bags.legs_bag(tmp_path / "b", COUNT, chunk_size=CHUNK)
    offset, inside = chunks_of(bag / "b_0.mcap")[0]
    (bag / "metadata.yaml").unlink()
    content = bytearray((bag / "b_0.mcap").read_bytes())
    content[: offset + 500] = bytes(offset + 500)  # magic, header, schema, channel and half of the first chunk
    (bag / "b_0.mcap").write_bytes(content)
    recover(bag, tmp_path / "r")  # the summary knows the channel
    assert opens_everywhere(tmp_path / "r") == list(range(inside[-1] + 1, COUNT))


def test_beginning_and_end_gone_but_metadata_yaml_knows(tmp_path):
    bag = bags.legs_bag(tmp_path / "b", COUNT, chunk_size=CHUNK)
    chunks = chunks_of(bag / "b_0.mcap")
    content = bytearray((bag / "b_0.mcap").read_bytes())
    content[: chunks[0][0] + 500] = bytes(chunks[0][0] + 500)
    (bag / "b_0.mcap").write_bytes(content[: chunks[-1][0] + 100])
    recover(bag, tmp_path / "r")
    assert opens_everywhere(tmp_path / "r") == list(range(chunks[0][1][-1] + 1, chunks[-1][1][0]))
    with Reader(tmp_path / "r") as reader:
        assert reader.connections[0].ext.offered_qos_profiles == [metadata.qos(depth=2000)]


def test_provenance_and_attachments_come_back(tmp_path):
    bag = bags.trial_bag(tmp_path / "b")
    recover(bag, tmp_path / "r")
    assert Bag.open(tmp_path / "r").provenance["trial"]["exit_status"] == "ok"
    assert table.row_from_bag(tmp_path / "r") == table.row_from_bag(bag)


def test_a_trial_with_parts_lost_is_for_a_person_to_judge(tmp_path):
    bag = bags.trial_bag(tmp_path / "b")
    file = bag / "b_0.mcap"
    file.write_bytes(file.read_bytes()[:-50_000])
    recover(bag, tmp_path / "r")
    assert table.row_from_bag(tmp_path / "r").status == "recovered, parts are lost"


def test_nothing_to_bring_back(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "b_0.mcap").write_bytes(b"")
    with pytest.raises(InputError, match="no message can be brought back"):
        recover(tmp_path / "b", tmp_path / "r")
    assert not (tmp_path / "r").exists()
    bag = bags.legs_bag(tmp_path / "whole", 3)
    with pytest.raises(InputError, match="exists already"):
        recover(bag, tmp_path / "whole")


def test_a_chunk_that_claims_to_be_huge(tmp_path):
    """A decompression bomb is damage, not a gigabyte of memory."""
    import lz4.frame
    import zstandard

    for name, bomb in (("zstd", zstandard.compress(bytes(1 << 30))), ("lz4", lz4.frame.compress(bytes(1 << 30)))):
        for claimed in (1 << 30, 1000):
            assert mcap_scan._decompressed(memoryview(bomb), name, claimed) is None
        assert len(mcap_scan._decompressed(memoryview(zstandard.compress(bytes(9))), "zstd", 9)) == 9


def library_file(path: Path, **options) -> None:
    """A file of the mcap library, without CRCs."""
    path.parent.mkdir()
    writer = McapLibraryWriter(str(path), enable_crcs=False, compression=CompressionType.NONE, **options)
    writer.start("ros2")
    kind = "sensor_msgs/msg/JointState"
    channel = writer.register_channel(
        "/leg_states", "cdr", writer.register_schema(kind, "ros2msg", interfaces.definition(kind).encode())
    )
    for i in range(40):
        writer.add_message(channel, bags.T0 + i, bags.joint_state(i, i), bags.T0 + i)
    writer.finish()


def originals(folder: Path) -> list[Path]:
    """Small bags of all storage forms to damage."""
    found = [bags.legs_bag(folder / kind, 40, chunk_size=3000, compression=kind) for kind in KINDS]
    library_file(folder / "unchunked" / "u.mcap", use_chunking=False)
    library_file(folder / "nocrc" / "n.mcap", chunk_size=3000)
    return [*found, folder / "unchunked", folder / "nocrc"]


def spoil(content: bytes, draw: random.Random) -> bytes:
    """One of the ways a file goes wrong."""
    data = bytearray(content)
    way = draw.randrange(5)
    if way == 0:
        for _ in range(draw.choice((1, 1, 2, 8, 64))):
            data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    elif way == 1:
        del data[draw.randrange(len(data)) :]
    elif way == 2:
        start = draw.randrange(len(data))
        length = draw.choice((1, 8, 50, 1000))
        data[start : start + length] = draw.randbytes(length)
    elif way == 3:
        start = draw.randrange(len(data))
        del data[start : start + draw.choice((1, 9, 500))]
    else:
        start = draw.randrange(len(data) - 8)
        data[start : start + 8] = draw.choice((b"\xff" * 8, bytes(8), (1 << 40).to_bytes(8, "little"), b"\x7f" * 8))
    return bytes(data)


def refusal(action) -> str:
    """The one line an action was refused with; empty if it was not. Any other exception is a failure."""
    try:
        action()
    except InputError as error:
        line = str(error)
    else:
        return ""
    assert line
    assert "\n" not in line
    return line


def use_recovered(bag: Path, target: Path) -> None:
    recover(bag, target)
    again = Bag.open(target)
    assert again.count == sum(1 for _ in again.messages())


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("cases", [200, pytest.param(2_000, marks=pytest.mark.whole)])
def test_fuzzed_bags_give_a_bag_or_one_line(tmp_path, cases):
    draw = random.Random(2009)
    sources = originals(tmp_path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    slowest, opened, refused = 0.0, 0, 0
    for case in range(cases):
        source = sources[case % len(sources)]
        bag = tmp_path / "case"
        shutil.rmtree(bag, ignore_errors=True)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        shutil.copytree(source, bag)
        (file,) = bag.glob("*.mcap")
        target = bag / "metadata.yaml" if draw.random() < 0.1 and (bag / "metadata.yaml").exists() else file
        target.write_bytes(spoil(target.read_bytes(), draw))
        start = time.perf_counter()
        if refusal(lambda: use_recovered(bag, tmp_path / "out")):  # noqa: B023 (called at once)
            refused += 1
        else:
            opened += 1
        refusal(lambda: Bag.open(bag).columns("/leg_states", "position"))  # noqa: B023
        refusal(lambda: Timeline(Bag.open(bag))[0])  # noqa: B023
        slowest = max(slowest, time.perf_counter() - start)
    assert opened > cases / 2
    assert refused > 0
    assert slowest < 5.0
    # ru_maxrss is in KiB.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1 << 20


@pytest.mark.parametrize("kind", KINDS)
def test_no_wrong_number_comes_out_of_a_fuzzed_bag(tmp_path, kind):
    """What a CRC vouches for is exactly what was written: flips never change a value that is given back."""
    draw = random.Random(7)
    source = bags.legs_bag(tmp_path / "b", 60, chunk_size=3000, compression=kind)
    good = {i: np.float64(i) + np.arange(6) / 8 for i in range(60)}
    content = (source / "b_0.mcap").read_bytes()
    for _ in range(100):
        data = bytearray(content)
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        (source / "b_0.mcap").write_bytes(data)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        recover(source, tmp_path / "out")
        for position in Bag.open(tmp_path / "out").columns("/leg_states", "position")["position"]:
            np.testing.assert_array_equal(position, good[int(position[0])])
