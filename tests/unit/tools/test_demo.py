"""``make demo`` replaces an earlier demo and nothing else, and goes on where its live part fails; commands are stood in
for. What it shows and says at its end is computed from what was measured.
"""

import math
import os
import subprocess
from pathlib import Path

import pytest

from demo_found import SAID, found
from sandbot_model.physics.catalogue import catalogue
from speed_plot import SpeedPlot

SCRIPT = Path(__file__).parents[3] / "tools" / "demo.sh"


@pytest.fixture
def demo(tmp_path):
    """Run the script in a folder of its own; ros2 and python only say what they were asked, ``fails`` as a failure."""

    def stand_in(name, fails):
        program = tmp_path / "bin" / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(f'#!/bin/bash\necho "{name} $*"\n[[ "$*" != *"{fails}"* ]]\n')
        program.chmod(0o755)

    for name in ("ros2", "python"):
        stand_in(name, "nothing at all")

    def run(out, seed="7", fails=""):
        for name in ("ros2", "python") if fails else ():
            stand_in(name, fails)
        environment = {**os.environ, "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}
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
    asked = [line for line in done.stdout.splitlines() if f"--out {tmp_path / 'old one'} --batch" in line]
    assert len(asked) == 1
    assert asked[0].endswith("li09_world.yaml --hide 7")
    assert f"demo_live.py {tmp_path / 'old one'}-live\n" in done.stdout
    assert "--model li09 " in done.stdout
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


def test_without_a_seed_the_world_is_the_papers_and_no_effect_is_drawn(demo, tmp_path):
    done = demo(tmp_path / "runs", seed="")
    assert (done.returncode, done.stderr) == (0, "")
    assert "li09_world.yaml\n" in done.stdout
    assert "--hide" not in done.stdout
    assert "--model simple " in done.stdout


@pytest.mark.parametrize("fails", ["demo_live.py", "sandbot_bringup unseal"])
def test_a_failed_live_part_or_a_wrong_verdict_ends_in_1_after_all_has_been_said(demo, tmp_path, fails):
    done = demo(tmp_path / "runs", fails=fails)
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].endswith(f"demo_found.py {tmp_path / 'runs'}")


def test_a_failed_campaign_ends_it(demo, tmp_path):
    """Control."""
    done = demo(tmp_path / "runs", fails="--batch")
    assert done.returncode == 1
    assert "discover" not in done.stdout


def test_a_live_campaign_of_another_name_stays(demo, tmp_path):
    another_campaign(tmp_path / "mine-live")
    assert refused(demo(tmp_path / "mine"), f"{tmp_path / 'mine-live'} is no earlier demo")


@pytest.mark.parametrize("seed", ["seven", "-1", "1.5", "7; ls", "9" * 30])
def test_a_seed_that_is_no_number_is_refused_and_nothing_removed(demo, tmp_path, seed):
    there = earlier_demo(tmp_path / "runs")
    assert refused(demo(there, seed), f"SEED: '{seed}' is not a whole number")
    assert (there / "campaign.yaml").exists()


def test_a_folder_without_a_name_is_refused(demo):
    assert refused(demo(""), "a folder's name is needed")


def plotted(speeds, interval_s=0.01):
    plot = SpeedPlot()
    lines = [line for number, speed in enumerate(speeds) for line in plot.add(100.0 + number * interval_s, speed)]
    return [*lines, *plot.rest()]


def test_speeds_are_plotted_half_a_second_a_line_as_high_as_they_are():
    first, second = plotted([0.3] * 50 + [0.15] * 25 + [0.0] * 25)
    assert first == "   0.5 s   30.0 cm/s  |" + 25 * "█" + "|"
    assert second.split("|")[1] in (12 * "▄" + "▃" + 12 * "▁", 12 * "▄" + "▂" + 12 * "▁")
    assert "  7.5 cm/s" in second


def test_what_was_not_measured_is_blank_and_what_is_too_fast_is_full():
    (line,) = plotted([9.0] * 10)
    assert line.split("|")[1] == 5 * "█" + 20 * " "
    assert plotted([]) == []
    # A frame that came late, a hidden marker: the tracker says NaN.
    (line,) = plotted([0.3] * 10 + [math.nan] * 10 + [0.3] * 10)
    assert line.split("|")[1] == 5 * "█" + 5 * " " + 5 * "█" + 10 * " "
    assert "30.0 cm/s" in line
    assert plotted([math.nan] * 3) == []
    assert len(plotted([0.1, 0.1], interval_s=2.0)) == 2  # nothing between them: no empty lines


def test_what_was_found_is_said_with_the_fitted_numbers():
    fitted = {"disturbed_ground.k_l_n_per_m": 181.7, "disturbed_ground.s_c": 0.998, "stance_overlap.eta": 0.123}
    steps = [{"cv_rmse_m_s": 0.077}, {"cv_rmse_m_s": 0.0048}]
    steps[1]["parameters"] = {name: {"value": value} for name, value in fitted.items()}
    discovery = {"model": "simple", "steps": steps, "noise_floor_m_s": 0.0047, "verdict": {"status": "identified"}}
    discovery["verdict"]["effects"] = ["disturbed_ground", "stance_overlap"]
    said = found(discovery)
    assert "within 1.00 R of the last foothold finds ground loosened to 182 N/m" in said
    assert "stance overlap (fraction of the speed lost while both tripods stand 0.123)" in said
    assert said.endswith("by 0.48 cm/s, without it by 7.70; replicates of one trial differ by 0.47.")


def test_where_nothing_is_named_nothing_is_said_to_be_found():
    """Control."""
    discovery = {"model": "simple", "steps": [{}], "verdict": {"status": "ambiguous", "effects": []}}
    assert found(discovery) == "Found: no effect is claimed; the verdict is ambiguous."


def test_every_effect_that_has_words_takes_its_numbers_from_the_catalogue():
    for name, words in SAID.items():
        assert words.format(**{one.name: 1.0 for one in catalogue()[name].parameters})
