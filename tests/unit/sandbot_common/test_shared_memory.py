"""Shared memory that is too small for a trackway, or full, is told before its nodes start."""

from types import SimpleNamespace

import pytest

from sandbot_common import shared_memory
from sandbot_common.errors import InputError


@pytest.fixture
def usage(monkeypatch):
    def set_usage(size_mb, free_mb):
        told = size_mb << 20, 0, int(free_mb * (1 << 20))
        monkeypatch.setattr(shared_memory.shutil, "disk_usage", lambda _: Usage(*told))

    return set_usage


class Usage(SimpleNamespace):
    """As ``shutil.disk_usage`` gives it."""

    def __init__(self, *values):
        super().__init__(total=values[0], free=values[2])
        self.values = values

    def __iter__(self):
        return iter(self.values)


@pytest.mark.parametrize(("size_mb", "is_short"), [(64, True), (511, True), (512, False), (16000, False)])
def test_what_docker_gives_is_told_with_what_helps(tmp_path, usage, size_mb, is_short):
    usage(size_mb, size_mb)
    told = shared_memory.shortage(tmp_path)
    assert bool(told) == is_short
    if is_short:
        assert told.startswith(f"{tmp_path} is {size_mb} MB, nodes need 512")
        assert "docker run --shm-size=1g" in told


def test_what_has_been_filled_is_told_with_what_helps(tmp_path, usage):
    usage(16000, 255)
    assert shared_memory.shortage(tmp_path).startswith(f"{tmp_path} has 255 MB free, nodes take up to 256")
    assert "trackway doctor" in shared_memory.shortage(tmp_path)
    usage(16000, 256)
    assert shared_memory.shortage(tmp_path) == ""


def test_only_where_nothing_is_left_is_a_campaign_refused(tmp_path, usage):
    """With 200 KB its trials were complete, over UDP; with none its recorders were not heard."""
    usage(16000, 0.9)
    with pytest.raises(InputError, match="is full, and a new node would not be heard: remove what fills it"):
        shared_memory.check_room(tmp_path)
    usage(64, 1)
    shared_memory.check_room(tmp_path)


def test_a_host_without_it_is_not_told(tmp_path):
    assert shared_memory.shortage(tmp_path / "none") == ""
    shared_memory.check_room(tmp_path / "none")
