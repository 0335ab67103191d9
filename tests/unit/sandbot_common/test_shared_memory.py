"""Shared memory that is too small for a trackway is told before its nodes start."""

from types import SimpleNamespace

import pytest

from sandbot_common import shared_memory


@pytest.mark.parametrize(("size_mb", "is_short"), [(64, True), (511, True), (512, False), (16000, False)])
def test_what_docker_gives_is_told_with_what_helps(tmp_path, monkeypatch, size_mb, is_short):
    monkeypatch.setattr(shared_memory.shutil, "disk_usage", lambda _: SimpleNamespace(total=size_mb << 20))
    told = shared_memory.shortage(tmp_path)
    assert bool(told) == is_short
    if is_short:
        assert told.startswith(f"{tmp_path} is {size_mb} MB, nodes need 512")
        assert "docker run --shm-size=1g" in told


def test_a_host_without_it_is_not_told(tmp_path):
    assert shared_memory.shortage(tmp_path / "none") == ""
