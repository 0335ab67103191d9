import os

import pytest

from ros2cli_fallback import bag, packages
from ros2cli_fallback.cover import Failure, NotCovered
from ros2cli_fallback.main import main, real_ros2


def program(folder, name="ros2"):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


@pytest.mark.parametrize(
    "command",
    [["doctor"], ["topic", "bw", "/x"], ["topic", "echo", "/x", "--nope"], ["param"], ["bag", "reindex", "x"]],
)
def test_what_is_not_covered_is_one_line_and_exit_2(command, capsys):
    assert main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "trackway's stand-in for ros2; it covers run, launch, topic list|echo|hz" in err


def test_help_says_what_it_is(capsys):
    assert main(["--use-python-default-buffering", "--help"]) == 0
    assert "stand-in" in capsys.readouterr().out


def test_the_real_ros2_is_found_wherever_it_stands_on_the_path(tmp_path, monkeypatch):
    own, other, real = (program(tmp_path / name) for name in ("tools", "another checkout/tools", "real"))
    for ours in (own, other):
        (ours.parent / "ros2cli_fallback").mkdir()
    link = tmp_path / "bin" / "ros2"
    link.parent.mkdir()
    link.symlink_to(own)
    monkeypatch.setenv("PATH", f"{link.parent}:{other.parent}:{real.parent}")
    assert real_ros2() == str(real)
    monkeypatch.setenv("PATH", f"{link.parent}:{other.parent}::{tmp_path / 'nothing'}")
    assert real_ros2() is None


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    marker = tmp_path / "share/ament_index/resource_index/packages/pack"
    marker.parent.mkdir(parents=True)
    marker.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    return tmp_path


def test_an_executable_is_found_through_the_ament_index(prefix):
    path = program(prefix / "lib/pack", "tool")
    assert packages.executable("pack", "tool") == path


def test_run_says_what_the_real_one_says(prefix, capsys):
    program(prefix / "lib/pack", "tool").chmod(0o644)
    assert main(["run", "nope", "tool"]) == 1
    assert capsys.readouterr().err == "Package 'nope' not found\n"
    assert main(["run", "pack", "tool"]) == 1
    assert capsys.readouterr().err == "No executable found; pack has: none\n"
    program(prefix / "lib/pack/a", "twin")
    program(prefix / "lib/pack/b", "twin")
    with pytest.raises(Failure, match="Multiple executables found:"):
        packages.executable("pack", "twin")


def test_run_of_a_package_alone_lists_what_it_has(prefix, capsys):
    for name in ("tool", "saw"):
        program(prefix / "lib/pack", name)
    (prefix / "lib/pack/notes.txt").write_text("not to be run")
    assert main(["run", "pack"]) == 2
    assert capsys.readouterr().err == "ros2 run: an executable is needed; pack has: saw, tool\n"
    assert main(["run", "pack", "hammer"]) == 1
    assert capsys.readouterr().err == "No executable found; pack has: saw, tool\n"


def test_run_becomes_the_executable_with_its_arguments(prefix, monkeypatch):
    path = program(prefix / "lib/pack", "tool")
    became = []

    def execvp(file, arguments):
        became.append((file, arguments))
        raise SystemExit(0)

    monkeypatch.setattr(os, "execvp", execvp)
    with pytest.raises(SystemExit):
        main(["run", "--prefix", "nice -n 5", "pack", "tool", "--flag", "--ros-args", "-p", "a:=1"])
    arguments = ["nice", "-n", "5", str(path), "--flag", "--ros-args", "-p", "a:=1"]
    assert became == [("nice", arguments)]


def test_bag_flags_are_translated(monkeypatch):
    monkeypatch.setattr(bag.time, "strftime", lambda form: "now")
    assert bag.translate(["record", "-o", "out", "/a", "/b"]) == ("record", ["/a", "/b", "--out", "out"])
    assert bag.translate(["record", "-a", "-s", "mcap", "-o", "x"]) == ("record", ["--out", "x", "--all"])
    assert bag.translate(["record", "-e", "/bed/.*"]) == ("record", ["--out", "now", "--regex", "/bed/.*"])
    assert bag.translate(["info", "x"]) == ("info", ["x"])
    assert bag.translate(["info", "-s", "sqlite3", "x"]) == ("info", ["x"])
    many = ["record", "-a", "-o", "x", "-x", "image", "-d", "60", "-b", "1048576", "--compression-format", "zstd"]
    split = ["--exclude", "image", "--max-duration", "60.0", "--max-size", "1.0", "--compression", "zstd"]
    assert bag.translate(many) == ("record", ["--out", "x", "--all", *split])
    clock = ["x", "--rate", "1.0", "--start", "0.0", "--clock", "--delay", "2.0", "--remap", "/a:=/b", "--topics", "/a"]
    given = ["play", "x", "--clock", "-d", "2", "-m", "/a:=/b", "--topics", "/a"]
    assert bag.translate(given) == ("replay", clock)
    name, arguments = bag.translate(["play", "x", "-r", "2", "-l", "--start-offset", "1.5"])
    assert (name, arguments) == ("replay", ["x", "--rate", "2.0", "--start", "1.5", "--loop"])


@pytest.mark.parametrize(
    ("command", "complaint"),
    [
        (["record", "-s", "sqlite3", "-a"], "sqlite3"),
        (["record", "-o", "x"], "name topics"),
        (["play", "x", "--read-ahead-queue-size", "9"], "--read-ahead"),
        (["record", "-a", "--rate", "fast"], "--rate"),
    ],
)
def test_bag_refuses_what_the_project_does_not_do(command, complaint):
    with pytest.raises(NotCovered, match=complaint):
        bag.translate(command)
