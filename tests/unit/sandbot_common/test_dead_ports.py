import os
import socket
from pathlib import Path

import pytest

from sandbot_common.dead_ports import MOST, dead_ports, remove_incomplete, reserved

SENDER, READER, GONE = 100, 200, 300


@pytest.fixture
def host(tmp_path: Path):
    """Port files with who holds their locks, and what the sender maps, as the system shows them."""
    memory, processes = tmp_path / "shm", tmp_path / "proc"
    memory.mkdir()
    for process in (SENDER, READER):
        (processes / str(process)).mkdir(parents=True)
        (processes / str(process) / "maps").write_text("")

    def host(read: dict[int, int], mapped: dict[int, str], left: tuple[int, ...] = ()):
        lines = []
        for port, process in read.items() | {(port, 0) for port in left}:
            lock = memory / f"fastrtps_port{port}_el"
            lock.touch()
            if process:
                lines.append(f"1: FLOCK  ADVISORY  WRITE {process} 00:1b:{lock.stat().st_ino} 0 EOF\n")
        (processes / "locks").write_text("".join([*lines, f"9: FLOCK  ADVISORY  WRITE {GONE} 00:1b:1 0 EOF\n"]))
        maps = [f"7f00-7f01 rw-s 00000000 00:1b 5  /dev/shm/fastrtps_port{port}{how}\n" for port, how in mapped.items()]
        (processes / str(SENDER) / "maps").write_text("".join([*maps, "7f02-7f03 r--p 0 fe:00 7  /usr/lib/x.so\n"]))
        return memory, processes

    return host


def test_a_port_that_is_sent_to_and_that_nobody_reads_is_dead(host):
    assert dead_ports(0, *host({7411: SENDER}, {7411: "", 7413: ""}, left=(7413,))) == [7413]


def test_so_is_one_whose_file_is_gone(host):
    assert dead_ports(0, *host({7411: SENDER}, {7411: "", 7413: " (deleted)"})) == [7413]


def test_one_that_is_read_is_not_though_its_file_be_another(host):
    assert dead_ports(0, *host({7411: SENDER, 7413: READER}, {7411: "", 7413: " (deleted)"})) == []


def test_nor_one_to_which_nobody_sends(host):
    assert dead_ports(0, *host({7411: SENDER}, {7411: ""}, left=(7413,))) == []


def test_nor_one_of_another_domain(host):
    arguments = host({7661: SENDER}, {7661: "", 7663: "", 7413: ""}, left=(7663, 7413))
    assert dead_ports(1, *arguments) == [7663]
    assert dead_ports(2, *arguments) == []


def test_where_the_system_tells_nothing_none_is_known(tmp_path):
    assert dead_ports(0, tmp_path, tmp_path / "proc") == []


def test_ports_that_nobody_will_finish_are_removed_and_no_others(tmp_path):
    files = {
        "fastrtps_port7411": b"",
        "fastrtps_port7413": bytes(64),
        "fastrtps_port7415": b"\x02" + bytes(63),
        "fastrtps_port7411_el": b"",
        "fastrtps_0123456789abcdef": b"",
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        os.utime(tmp_path / name, (0, 0))
    (tmp_path / "fastrtps_port7417").touch()  # just being made
    remove_incomplete(tmp_path)
    kept = {path.name for path in tmp_path.iterdir()}
    assert kept == {"fastrtps_port7415", "fastrtps_port7411_el", "fastrtps_0123456789abcdef", "fastrtps_port7417"}


def free() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("", 0))
        return one.getsockname()[1]


def taken(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.bind(("", port))
        except OSError:
            return True
        return False


def test_a_dead_ones_number_is_kept_while_a_node_starts_and_no_longer():
    port = free()
    with reserved([port + 1]), reserved([port + 1]):  # two nodes that start at once
        assert taken(port)
    assert not taken(port)


def test_of_too_many_none_is_kept():
    port = free()
    with reserved([port + 1] * (MOST + 1)):
        assert not taken(port)
