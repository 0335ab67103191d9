"""--robot and --cameras: whose numbers compare, discover and explore use, and what they refuse."""

import argparse
import json
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from sandbot_common.accuracy import Accuracy
from sandbot_common.cli import Parser
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot, to_mapping
from sandbot_common.yaml_text import dump_yaml
from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.app import Explorer
from sandbot_model.tools import arguments, compare, discover, explore
from sandbot_record.trials import read as reading
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.table import Row, from_rows

BIG = Robot(leg_radius_m=0.05, mass_per_leg_kg=1.5)
COMMANDS = (compare, discover, explore)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A table of SandBot, and files to name."""
    rows = [
        Row(f"{phi} {omega} {n}", phi, 0.001, omega, "UNIFORM", n, 0.013 * omega, 0.001, 0.015, 0.0355 * omega, 0.05)
        for phi in (0.59, 0.61, 0.63)
        for omega in (6.0, 9.0, 12.0)
        for n in range(2)
    ]
    write_csv(
        from_rows([replace(row, speed_m_s=row.speed_m_s + 0.001 * row.replicate) for row in rows]), tmp_path / "t.csv"
    )
    texts = {
        "big": dump_yaml(to_mapping(BIG)),
        "mm": "leg_radius_mm: 50",
        "fast": "dorsal: {frame_rate_hz: 200.0}\naccuracy: {lift_m: 0.002}",
        "wrong": "dorsal: {frame_rate_hz: 200.0}\naccuracy: {lift: 0.002}",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def served(monkeypatch):
    """What the explorer's servers were to say, which none says."""
    said = []
    monkeypatch.setattr(explore, "_serve", lambda _desk, _first, _campaigns, line: said.append(line))
    return said


def told(*words):
    """The trials and the line that a command's options give."""
    parser = Parser(prog="test")
    parser.add_argument("data", type=Path, nargs="+")
    arguments.add_setting(parser)
    return arguments.trials(parser.parse_args(words))


def test_a_table_is_sandbots_until_another_robot_is_named(folder):
    trials, line = told("t.csv")
    assert trials.robot is None
    assert line == "robot: not given, SandBot is assumed (--robot FILE.yaml names another)"
    trials, line = told("t.csv", "--robot", "big.yaml")
    assert (trials.robot, line) == (BIG, "robot: big.yaml")


def test_a_report_is_called_as_asked_or_as_its_data(tmp_path, monkeypatch):
    (folder := tmp_path / "2024.05.12").mkdir()
    monkeypatch.chdir(folder)
    titles = [arguments.title(argparse.Namespace(title=asked, data=[Path()])) for asked in (None, "mine")]
    assert titles == ["2024.05.12", "mine"]


def test_the_table_of_a_campaign_has_the_robot_of_the_file_beside_it(folder):
    Path("runs").mkdir()
    Path("t.csv").rename("runs/trials.csv")
    Path("big.yaml").rename("runs/robot.yaml")
    for words in (["runs/trials.csv"], ["runs"]):
        trials, line = told(*words)
        assert (trials.robot, line) == (BIG, "robot: runs/robot.yaml")
    Path("small.yaml").write_text(dump_yaml(to_mapping(SANDBOT)), encoding="utf-8")
    trials, line = told("runs/trials.csv", "--robot", "small.yaml")
    assert trials.robot == SANDBOT
    assert line.startswith("robot: small.yaml in place of the data's own (")


def test_cameras_tell_frame_rate_and_accuracy(folder):
    trials, _ = told("t.csv", "--cameras", "fast.yaml")
    assert (trials.frame_rate_hz, trials.accuracy) == (200.0, Accuracy(lift_m=0.002))
    assert told("t.csv")[0].accuracy is None


def test_a_robot_named_goes_before_the_bags_own_and_that_is_said():
    own = from_rows([Row("a", 0.6)], SANDBOT)
    trials, line = arguments.of_robot(own, BIG, "big.yaml")
    assert trials.robot == BIG
    assert "in place of the data's own (leg_radius_m 0.05 and 0.0355" in line
    assert arguments.of_robot(own, SANDBOT, "same.yaml")[1] == "robot: same.yaml"
    with pytest.raises(InputError, match="the first steps in DATA were read with 0"):
        arguments.of_robot(own, Robot(leg_mount_rad=0.5), "mounted.yaml")


def test_data_beside_are_of_the_same_robot_or_refused(folder, monkeypatch):
    tables = {"ours": None, "sandbot": SANDBOT, "big": BIG}
    monkeypatch.setattr(reading, "read", lambda data: from_rows([Row("a", 0.6)], tables[str(data)]))

    def robot(of_data, of_beside, named=None):
        args = argparse.Namespace(robot=named, cameras=None)
        return arguments.beside(args, from_rows([Row("a", 0.6)], tables[of_data]), Path(of_beside)).robot

    assert robot("big", "ours") == robot("big", "big") == BIG
    assert robot("ours", "sandbot") == robot("ours", "ours") == SANDBOT
    assert robot("ours", "ours", folder / "big.yaml") == robot("sandbot", "big", folder / "big.yaml") == BIG
    for of_data in ("ours", "sandbot"):
        with pytest.raises(InputError, match="--beside big: trials of another robot than DATA"):
            robot(of_data, "big")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--robot", "absent.yaml"], "absent.yaml: no such file"),
        (["--robot", "mm.yaml"], "say leg_radius_m (values divided by 1000)"),
        (["--cameras", "absent.yaml"], "absent.yaml: no such file"),
        (["--cameras", "big.yaml"], "no camera is called 'leg_radius_m'; known: dorsal, lateral"),
        (["--cameras", "wrong.yaml"], "wrong.yaml: accuracy: unknown key 'lift'"),
        (["--penetrometer", "absent.csv"], "absent.csv: no such file"),
        (["--penetrometer", "t.csv"], "t.csv: row 1: columns phi, depth_m, force_n or phi, k_n_per_m are needed"),
    ],
)
def test_files_that_are_none_are_refused_in_one_line(folder, served, capsys, command, options, words):
    assert command.main(["t.csv", *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not served


@pytest.mark.parametrize("command", [compare, discover])
def test_commands_fit_and_print_the_robot_named(folder, capsys, command):
    few = ["--max-effects", "0", "--workers", "1"] if command is discover else []
    assert command.main(["t.csv", "--robot", "big.yaml", "--cameras", "fast.yaml", *few, "--json", "out.json"]) == 0
    assert "robot: big.yaml\n" in capsys.readouterr().out.replace(" \n", "\n")
    content = json.loads((folder / "out.json").read_text(encoding="utf-8"))
    assert content["robot"] == to_mapping(BIG)


def test_the_explorer_says_whose_robot_it_shows_and_saves_a_command_that_reads_the_same(folder, served, monkeypatch):
    made = []
    shown = Explorer.__init__

    def seen(self, *words):
        shown(self, *words)
        made.append(self)

    monkeypatch.setattr(Explorer, "__init__", seen)
    bed = ["--bed-scatter", "0.003"]
    assert explore.main(["t.csv", "--robot", "big.yaml", "--cameras", "fast.yaml", "--workers", "1", *bed]) == 0
    assert served == ["robot: big.yaml"]
    assert "; robot: big.yaml" in str(made[0].app().layout)
    command = shlex.split(yaml.safe_load(made[0].saved(Selection()))["command"])
    assert command[command.index("--robot") + 1] == "big.yaml"
    assert command[command.index("--cameras") + 1] == "fast.yaml"
    # What is known of the bed is no matter of ``compare``.
    assert "compare" in command
    assert "--bed-scatter" not in command


@pytest.mark.parametrize("command", [discover, explore])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--bed-drift", "0.01"], "--bed-drift 0.01: DATA do not say in which order trials were run"),
        (["--bed-drift", "0"], "--bed-drift 0: a fraction above 0 and up to 0.3 is needed"),
        (["--bed-scatter", "0.7"], "--bed-scatter 0.7: a fraction above 0 and up to 0.3 is needed"),
    ],
)
def test_what_is_said_of_the_bed_in_vain_is_refused(command, words, said, folder, served, capsys):
    out = ["--json", "out.json"] if command is discover else []
    assert command.main(["t.csv", *words, *out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not (folder / "out.json").exists()
    assert not served


def test_data_that_can_not_be_used_still_open_a_page(folder, served, capsys):
    (folder / "none.csv").write_text("phi,omega_rad_s,speed_m_s\n", encoding="utf-8")
    assert explore.main(["none.csv", "--bed-drift", "0.01", "--workers", "1"]) == 0
    assert served == [""]
    assert "none.csv: no trials" in capsys.readouterr().err
