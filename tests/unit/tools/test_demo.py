"""``make demo`` replaces an earlier demo and nothing else; the commands it runs are stood in for."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[3] / "tools" / "demo.sh"


@pytest.fixture
def demo(tmp_path):
    """Run the script in a folder of its own, with a ros2 that only says what it was asked."""
    ros2 = tmp_path / "bin" / "ros2"
    ros2.parent.mkdir()
    ros2.write_text('#!/bin/bash\necho "ros2 $*"\n')
    ros2.chmod(0o755)

    def run(out, seed="7"):
        environment = {**os.environ, "PATH": f"{ros2.parent}:{os.environ['PATH']}"}
        command = ["bash", str(SCRIPT), str(out), seed]
        return subprocess.run(command, env=environment, cwd=tmp_path, text=True, capture_output=True, timeout=60)

    return run


def earlier_demo(folder, name="demo"):
    (folder / "trials" / "t1").mkdir(parents=True)
    (folder / "campaign.yaml").write_text(f"name: {name}\nseed: 1\n")
    (folder / "truth").mkdir()
    return folder


def refused(done, complaint):
    (line,) = done.stderr.splitlines()
    return (done.returncode, done.stdout) == (2, "") and complaint in line


@pytest.mark.parametrize("there", [earlier_demo, Path.mkdir, lambda folder: None], ids=["demo", "empty", "absent"])
def test_an_earlier_demo_an_empty_and_an_absent_folder_are_replaced(demo, tmp_path, there):
    there(tmp_path / "old one")
    done = demo(tmp_path / "old one")
    assert (done.returncode, done.stderr) == (0, "")
    assert f"--out {tmp_path / 'old one'} --batch --hide 7\n" in done.stdout
    assert not (tmp_path / "old one").exists()  # nobody has written it anew here


def precious(folder):
    folder.mkdir()
    (folder / "thesis.tex").write_text("years")


def precious_beside_a_plan(folder):
    precious(folder)
    (folder / "campaign.yaml").write_text("name: demo\n")


def another_campaign(folder):
    earlier_demo(folder, "measured-in-march")


def link_to_a_file(folder):
    folder.with_name("letter").write_text("dear")
    folder.symlink_to(folder.with_name("letter"))


@pytest.mark.parametrize("there", [precious, precious_beside_a_plan, another_campaign, link_to_a_file, Path.touch])
def test_whatever_is_no_earlier_demo_stays(demo, tmp_path, there):
    there(tmp_path / "mine")
    before = sorted(tmp_path.rglob("*"))
    assert refused(demo(tmp_path / "mine"), f"{tmp_path / 'mine'} is no earlier demo")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("seed", ["", "seven", "-1", "1.5", "7; ls", "9" * 30])
def test_a_seed_that_is_no_number_is_refused_and_nothing_removed(demo, tmp_path, seed):
    there = earlier_demo(tmp_path / "runs")
    assert refused(demo(there, seed), f"SEED: '{seed}' is not a whole number")
    assert (there / "campaign.yaml").exists()


def test_a_folder_without_a_name_is_refused(demo):
    assert refused(demo(""), "a folder's name is needed")
