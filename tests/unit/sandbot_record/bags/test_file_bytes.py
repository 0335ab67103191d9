"""A file read piece by piece is its bytes; one that is lost meanwhile is an error in one line."""

import errno
import os
import shutil
from pathlib import Path

import bags
import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_record.bags import reader
from sandbot_record.bags.file_bytes import FileBytes, FileLost
from sandbot_record.bags.playback import Player, Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.recover import recover
from sandbot_record.trials import from_bags


@pytest.fixture
def content():
    return np.random.default_rng(1).bytes(300_000)


def test_slices_and_bytes_are_those_of_the_file(tmp_path, content):
    (tmp_path / "f").write_bytes(content)
    data = FileBytes(tmp_path / "f")
    assert len(data) == len(content)
    for start, end in ((0, 9), (5, 9), (65_000, 66_000), (0, 300_000), (100_000, 250_000), (-8, None), (7, 7), (9, 5)):
        assert data[start:end] == content[start:end]
    assert data[299_990:400_000] == content[299_990:]
    assert [data[0], data[150_000], data[299_999]] == [content[0], content[150_000], content[299_999]]
    with pytest.raises(IndexError):
        data[300_000]
    (tmp_path / "empty").touch()
    assert FileBytes(tmp_path / "empty")[:] == b""


def test_it_is_closed_when_it_is_not_needed_any_more(tmp_path):
    (tmp_path / "f").write_bytes(b"abc")
    before = len(os.listdir("/proc/self/fd"))
    assert FileBytes(tmp_path / "f")[:2] == b"ab"
    assert len(os.listdir("/proc/self/fd")) == before


def test_what_can_no_longer_be_read_is_one_line(tmp_path, content, monkeypatch):
    file = tmp_path / "f"
    file.write_bytes(content)
    data = FileBytes(file)
    with file.open("ab") as more:
        more.write(b"more")
    assert data[-5:] == content[-5:]  # that it grew is no matter
    os.truncate(file, 200_000)
    assert data[1000:150_000] == content[1000:150_000]
    with pytest.raises(FileLost, match="f: was truncated from 300000 to 200000 bytes while it was read"):
        data[100_000:250_000]

    def lost(*_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "pread", lost)
    with pytest.raises(FileLost, match="f: Input/output error"):
        data[0:100_000]
    with pytest.raises(FileLost, match="g: No such file or directory"):
        FileBytes(tmp_path / "g")


@pytest.fixture
def large(tmp_path, monkeypatch):
    """A bag that is not kept in memory."""
    monkeypatch.setattr(reader, "_KEEP_BYTES", 1000)
    return bags.legs_bag(tmp_path / "large", 2000, chunk_size=9000)


def storage(bag: Path) -> Path:
    return next(bag.glob("*.mcap"))


def test_a_bag_truncated_while_it_is_read(large, tmp_path):
    bag = Bag.open(large)
    assert bag.columns("/leg_states", "position")["position"][:, 0].tolist() == list(range(2000))
    timeline = Timeline(bag)
    assert timeline[0].log_time_ns == bags.T0
    read = bag.messages()
    next(read)
    os.truncate(storage(large), 150_000)
    lost = r"large_0.mcap: was truncated from \d+ to 150000 bytes while it was read"
    with pytest.raises(FileLost, match=lost):
        list(read)
    with pytest.raises(FileLost, match=lost):
        timeline[1999]
    player = Player(timeline, start_s=1.999)
    with pytest.raises(FileLost, match=lost):
        player.step(0)


def test_the_same_while_it_is_opened_recovered_or_measured(large, tmp_path, monkeypatch):
    whole = shutil.copytree(large, tmp_path / "whole")
    recover(whole, tmp_path / "r")
    real, reads = os.pread, []

    def cutting(fd, count, at):
        reads.append(at)
        if len(reads) == 10:
            os.truncate(storage(large), 20_000)
        return real(fd, count, at)

    monkeypatch.setattr(os, "pread", cutting)
    for read in (Bag.open, from_bags.row_from_bag, lambda bag: recover(bag, tmp_path / "r2")):
        shutil.rmtree(large)
        shutil.copytree(whole, large)
        reads.clear()
        with pytest.raises(InputError, match="to 20000 bytes while it was read") as error:
            read(large)
        assert "\n" not in str(error.value)
    assert not (tmp_path / "r2").exists()


def test_a_small_bag_is_in_memory_once_it_is_open(tmp_path):
    bag = Bag.open(bags.legs_bag(tmp_path / "small", 100))
    os.truncate(storage(tmp_path / "small"), 0)
    assert bag.columns("/leg_states", "position")["position"][:, 0].tolist() == list(range(100))
    assert len(list(bag.messages())) == 100


def test_a_bag_overwritten_in_place_while_it_is_replayed(large, tmp_path):
    timeline = Timeline(Bag.open(large))
    other = bags.legs_bag(tmp_path / "other", 3000, chunk_size=7000)
    shutil.copyfile(storage(other), storage(large))
    with pytest.raises(FileLost, match=r"large_0.mcap: was overwritten at byte \d+ while it was read"):
        timeline[1000]
