"""Every command of README and docs is typed as it stands into one fresh shell, whose environment is empty."""

import os
import re
import subprocess
import sys

import pytest

import pasted
from pasted import ALL, QUICK, ROOT, as_typed, commands, fresh_shell

TUTORIAL = [line for line in commands(ROOT / "docs" / "tutorial.md") if "explore" not in line]
README = [line for line in commands(ROOT / "README.md") if not re.match(r"make |ros2 launch|.*runs/monday", line)]


@pytest.fixture
def desk(tmp_path):
    """A reader's folder."""
    return pasted.prepared(tmp_path)


def test_the_pages_are_read():
    assert len(QUICK) > 12
    assert len(README) > 20
    assert len(TUTORIAL) > 8
    assert any("campaign demo.yaml" in line for line in QUICK)
    for part in (*pasted.ELSEWHERE, *pasted.LONGER):
        assert any(part in line for line in ALL), part


def test_the_table_has_every_command_and_each_ended_as_it_should():
    rows = list(pasted.rows_of(pasted.PAGE.read_text(encoding="utf-8")))
    assert [line for line, _ in rows] == ALL, "python tools/pasted.py --new adds what is missing"
    for line, code in rows:
        if pasted.one_of(list(pasted.ELSEWHERE), line):
            assert code == "–"
        else:
            assert pasted.right(line, int(code)), (line, code)


def test_every_target_of_make_exists():
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = {line.split()[1] for line in ALL if line.startswith("make ")}
    assert {"demo", "test", "faults", "rerun"} <= named <= targets


def first_of_each(lines):
    """Of each program the first command."""
    found = {}
    for line in lines:
        words = line.split()
        program = words[3] if words[:2] == ["ros2", "run"] else " ".join(words[:2])
        found.setdefault(program, line)
    return list(found.values())


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "lines", [pytest.param(first_of_each(QUICK), id="sample"), pytest.param(QUICK, id="all", marks=pytest.mark.whole)]
)
def test_every_command_is_understood_in_a_fresh_shell(tmp_path, lines):
    desk = pasted.with_campaigns(tmp_path)
    codes = fresh_shell(["source env.sh", *map(as_typed, lines)], desk, 500)
    assert {line: code for line, code in codes.items() if code} == {}, (desk / "err.txt").read_text()


def test_a_command_that_is_wrong_would_be_seen(desk):
    codes = fresh_shell(["source env.sh", "ros2 run sandbot_bringup campaign dmo.yaml --dry-run"], desk, 100)
    assert list(codes.values()) == [0, 2]
    assert not pasted.right("ros2 run sandbot_bringup campaign dmo.yaml", 2)
    assert not pasted.right("trackway compare table.csv", 130)
    assert list(pasted.rows_of("| `a \\| b` | README.md | as it stands | 2 |\n")) == [("a | b", "2")]


@pytest.mark.whole
@pytest.mark.timeout(3600)
def test_the_tutorial_in_a_fresh_clone(tmp_path):
    """As a newcomer does it: clone, ``make setup``, then every line of the tutorial in a shell that nobody prepared."""
    clone, log = tmp_path / "clone", tmp_path / "setup.txt"
    subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(clone)], check=True)
    # pip's own settings say where wheels come from; nothing else of this environment is there.
    kept = {name: value for name, value in os.environ.items() if name == "HOME" or name.startswith("PIP_")}
    with log.open("w") as said:
        done = subprocess.run(
            ["make", "setup", f"PYTHON={sys._base_executable}"], cwd=clone, env=kept | {"PATH": "/usr/bin:/bin"},
            stdout=said, stderr=subprocess.STDOUT, check=False,
        )  # fmt: skip
    assert done.returncode == 0, log.read_text()[-2000:]
    codes = fresh_shell(TUTORIAL, clone, 2700)
    assert {line: code for line, code in codes.items() if code} == {}, (clone / "err.txt").read_text()
    told = (clone / "out.txt").read_text()
    for promised in (
        "simple model fails",
        "verdict: identified: stance_overlap",
        "truth:   agrees",
        "verdict: untested",
    ):
        assert promised in told


@pytest.mark.whole
@pytest.mark.timeout(3600)
def test_readme_from_its_first_line_to_its_last(desk):
    codes = fresh_shell(["source env.sh", *README], desk, 3500)
    assert {line: code for line, code in codes.items() if code} == {}, (desk / "err.txt").read_text()
