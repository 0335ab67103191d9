"""trackway doctor: each check with what is there and what is not."""

import fcntl
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import pytest

from sandbot_common.errors import InputError
from trackway_command import doctor
from trackway_command.doctor import Finding

Usage = namedtuple("Usage", "total used free")


def test_a_failure_is_exit_1_and_a_warning_is_not(capsys):
    warned = [Finding("ok", "a", "fine", "nothing"), Finding("warn", "b", "odd", "mend it")]
    assert doctor.tell(warned) == 0
    out = capsys.readouterr().out
    assert "nothing" not in out
    assert "→ mend it" in out
    assert doctor.tell([*warned, Finding("fail", "c", "broken")]) == 1


@pytest.mark.parametrize("patience", ["inf", "nan", "0", "-3"])
def test_a_patience_that_is_none_is_refused(patience):
    with pytest.raises(InputError, match=f"--patience: {patience} is not above 0"):
        doctor.main(["--patience", patience])


def test_python():
    assert doctor.python((3, 11, 0)).level == "ok"
    assert doctor.python((3, 10, 9)).level == "fail"


def test_wheels_that_are_missing_or_older_are_named(tmp_path):
    lock = tmp_path / "requirements.lock"
    lock.write_text("# wheels\nnumpy==2.0.0\nscipy==1.14.0\npy_thing==1.0\n")
    have = {"numpy": "2.0.0", "scipy": "1.13.0", "py-thing": "1.0"}
    found = doctor.wheels(lock, have)
    assert (found.level, found.found) == ("warn", "1 of 3 are missing or of another version: scipy")
    assert doctor.wheels(lock, have | {"scipy": "1.14.0"}).level == "ok"


def test_a_package_that_is_not_built_is_named(tmp_path):
    for name in ("one", "two"):
        (tmp_path / "src" / name).mkdir(parents=True)
        (tmp_path / "src" / name / "package.xml").touch()
    (tmp_path / "install" / "one").mkdir(parents=True)
    assert doctor.workspace(tmp_path).found == "not built: two"
    (tmp_path / "install" / "two").mkdir()
    assert doctor.workspace(tmp_path).level == "ok"


def test_ros2_is_the_real_one_or_the_fallback():
    assert "the real one, /opt/ros2" in doctor.ros2("/opt/ros2").found
    assert "fallback" in doctor.ros2(None).found


def test_a_message_that_does_not_come_back_is_a_failure():
    assert doctor.messages(lambda: 0.0012).level == "ok"
    assert "back in 1.2 ms" in doctor.messages(lambda: 0.0012).found
    assert doctor.messages(lambda: "within 20 s").level == "fail"


@pytest.mark.ros
@pytest.mark.slow
def test_a_message_goes_to_another_process_and_back(domain, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    took = doctor.round_trip_s(60.0)
    assert isinstance(took, float), took
    assert 0.0 < took < 60.0


def segment(folder, name, size):
    (folder / name).write_bytes(b"x" * size)
    lock = folder / f"{name}_el"
    lock.touch()
    return lock


def test_memory_of_nodes_that_were_killed_is_told_from_that_of_living_ones(tmp_path, monkeypatch):
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda _: Usage(9 << 30, 0, 8 << 30))
    assert doctor.shared_memory(tmp_path).level == "ok"
    with segment(tmp_path, "fastrtps_living", 10).open() as living:
        fcntl.flock(living, fcntl.LOCK_EX)
        assert doctor.shared_memory(tmp_path).level == "ok"
        segment(tmp_path, "fastrtps_dead", 3 << 20)
        found = doctor.shared_memory(tmp_path)
    assert (found.level, found.found) == ("warn", "3 MB in 1 file of nodes that were killed; 8.0 GB free")
    assert "rm -f" in found.remedy


@pytest.mark.parametrize(
    ("total", "free", "remedy"),
    [
        (64 << 20, 64 << 20, "docker run --shm-size=1g"),  # Docker's default, which no removal makes larger
        (1 << 30, 1 << 20, "end what else uses it"),
        (1 << 30, 510 << 20, "rm -f"),  # with the 3 MB of a node that was killed it is enough
    ],
)
def test_too_little_shared_memory_has_a_remedy_that_helps(tmp_path, monkeypatch, total, free, remedy):
    segment(tmp_path, "fastrtps_dead", 3 << 20)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda _: Usage(total, total - free, free))
    found = doctor.shared_memory(tmp_path)
    assert found.level == "fail"
    assert remedy in found.remedy


@pytest.mark.ros
@pytest.mark.slow
def test_a_node_that_is_killed_leaves_what_doctor_finds_and_one_that_lives_does_not(domain):
    alive = "import rclpy; rclpy.init(); node = rclpy.create_node('left'); print('up', flush=True); rclpy.spin(node)"
    before = set(doctor.leftovers(doctor.SHARED_MEMORY))
    with subprocess.Popen([sys.executable, "-c", alive], stdout=subprocess.PIPE, text=True) as node:
        try:
            assert node.stdout.readline() == "up\n"
            held = {lock.with_name(lock.name.removesuffix("_el")) for lock in held_by(node.pid)}
            assert held
            assert held.isdisjoint(doctor.leftovers(doctor.SHARED_MEMORY))
        finally:
            node.kill()
    left = held & set(doctor.leftovers(doctor.SHARED_MEMORY))
    assert left
    for path in left - before:
        path.unlink()
        path.with_name(f"{path.name}_el").unlink(missing_ok=True)


def held_by(pid):
    """Lock files of shared memory that a process has open."""
    opened = (Path(link).readlink() for link in Path(f"/proc/{pid}/fd").iterdir())
    return [path for path in opened if path.name.startswith("fastrtps_") and path.name.endswith("_el")]


def test_cameras_that_may_not_be_opened_are_named(tmp_path, monkeypatch):
    assert doctor.cameras([]).level == "ok"
    device = tmp_path / "video0"
    device.touch()
    assert doctor.cameras([device]).found == str(device)
    monkeypatch.setattr(doctor.os, "access", lambda *_: False)
    assert doctor.cameras([device]).level == "warn"


@pytest.mark.parametrize(("free", "level"), [(100 << 30, "ok"), (2 << 30, "warn"), (10 << 20, "fail")])
def test_disk(free, level, tmp_path, monkeypatch):
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda _: Usage(1, 0, free))
    assert doctor.disk("disk", tmp_path).level == level


def test_chromium_is_only_for_the_browser_tests():
    assert doctor.browser(lambda name: f"/usr/bin/{name}").level == "ok"
    assert doctor.browser(lambda _: None).level == "warn"
