"""What README.md tells a reader to type or to write works as it stands, and every promised command is installed."""

import json
import os
import re
import subprocess
from importlib.metadata import distribution
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from sandbot_bringup import node_table
from sandbot_model.physics.catalogue import effects_in
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.walking import Inputs, Walker

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")

# Every executable of the design; unseal, which opens the virtual lab's truth; the virtual lab's penetrometer.
EXECUTABLES = {
    "sandbot_clock": ("clock",),
    "sandbot_bed": ("bed",),
    "sandbot_tracking": ("tracker", "camera", "calibrate", "track_video"),
    "sandbot_model": ("predictor", "compare", "discover", "explore", "effects", "atlas", "export"),
    "sandbot_lab": ("lab", "penetrometer"),
    "sandbot_record": ("record", "replay", "recover", "info", "table"),
    "sandbot_bringup": ("campaign", "console", "scene", "unseal"),
}
ALL = [(package, name) for package, names in EXECUTABLES.items() for name in names]

# Nodes take ROS arguments only; the others are commands with a --help of their own.
NODES = {"clock", "bed", "tracker", "camera", "predictor", "lab", "console", "scene"}
COMMANDS = [(package, name) for package, name in ALL if name not in NODES]

RUNS = re.findall(r"^    trackway (\w+)([^`\n]*)", README, re.MULTILINE)
PACKAGE = {name: package for package, name in ALL}

# Replicates at three volume fractions; at 8 rad/s φ acts against the model, so that it fails and effects are tried.
MORE_ROWS = "".join(
    f"{phi},{omega},{speed + spread:.4f}\n"
    for phi, omega, speed in (
        (0.58, 8, 0.092), (0.58, 12, 0.108), (0.58, 16, 0.128), (0.58, 20, 0.143),
        (0.6, 8, 0.087), (0.6, 12, 0.115), (0.6, 16, 0.136), (0.6, 20, 0.152),
        (0.633, 8, 0.078), (0.633, 12, 0.126), (0.633, 20, 0.217),
    )
    for spread in (-0.002, 0.002)
)  # fmt: skip


def main_of(package, name):
    """What the console script calls."""
    (entry,) = distribution(package).entry_points.select(group="console_scripts", name=name)
    return entry.load()


def block(first_line):
    """The indented block of README.md that begins with ``first_line``, without its indent."""
    lines = README.splitlines()
    start = lines.index(f"    {first_line}")
    taken = []
    for line in lines[start:]:
        if line and not line.startswith("    "):
            break
        taken.append(line[4:])
    return "\n".join(taken)


@pytest.fixture
def run(monkeypatch, capsys):
    """Run a command in this process; its standard output. Fails on any exit code but 0."""

    def _run(package, name, *arguments):
        monkeypatch.setattr("sys.argv", [name])
        code = main_of(package, name)([str(one) for one in arguments])
        out, err = capsys.readouterr()
        assert code == 0, err
        return out

    return _run


@pytest.fixture
def table(tmp_path):
    """The example table of README.md with a few rows more."""
    path = tmp_path / "table.csv"
    example = block("phi,omega_rad_s,speed_m_s").split("\n\n")[0]
    path.write_text(f"{example}\n{MORE_ROWS}")
    return path


@pytest.fixture
def boost_file(tmp_path):
    """The effect of README.md as a file of the name it gives."""
    text = block("# boost.py").split("\n\ntrackway ")[0] + "\n"
    path = tmp_path / "boost.py"
    path.write_text(text)
    return path


@pytest.fixture
def help_of(capsys):
    def _help(package, name):
        with pytest.raises(SystemExit) as ended:
            main_of(package, name)(["--help"])
        assert ended.value.code == 0
        return capsys.readouterr().out

    return _help


@pytest.mark.parametrize(("package", "name"), ALL)
def test_each_executable_of_the_design_is_installed_and_imports(package, name):
    script = Path(get_package_prefix(package)) / "lib" / package / name
    assert os.access(script, os.X_OK)
    assert callable(main_of(package, name))


def test_no_executable_is_installed_that_the_design_does_not_know():
    installed = {
        (package, path.name)
        for package in (*EXECUTABLES, "sandbot_common")
        for path in (Path(get_package_prefix(package)) / "lib" / package).glob("*")
    }
    assert installed == set(ALL)


@pytest.mark.parametrize(("package", "name"), COMMANDS)
def test_each_command_helps(package, name, help_of):
    text = help_of(package, name)
    assert text.startswith(f"usage: {name} ")


def test_each_command_line_of_the_readme_names_an_executable_and_its_options(help_of):
    assert len(RUNS) > 4
    for name, arguments in RUNS:
        text = help_of(PACKAGE[name], name)
        for option in re.findall(r"--[a-z-]+", arguments):
            assert f"{option} " in text or f"{option}\n" in text or f"{option}]" in text, (name, option)


def test_options_told_in_passing_exist(help_of):
    assert "--dry-run" in help_of("sandbot_bringup", "campaign")
    assert "--effect " in help_of("sandbot_model", "discover")


def test_launch_files_and_their_arguments_exist():
    launches = re.findall(r"ros2 launch (\w+) (\S+)([^`\n]*)", README)
    assert launches
    for package, file, arguments in launches:
        assert (Path(get_package_share_directory(package)) / "launch" / file).is_file()
        known = node_table.read_table(node_table.table_path()).arguments
        assert set(re.findall(r"(\w+):=", arguments)) <= set(known)


def test_a_second_make_builds_nothing_again():
    """A folder among what the workspace is built from is newer as soon as Python writes its bytecode there."""
    show = ["make", "--no-print-directory", "--eval", "show: ; @echo $(PACKAGE_FILES)", "show"]
    built_from = subprocess.run(show, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert {"trackway.launch.py", "setup.py", "demo.yaml"} <= {Path(name).name for name in built_from}
    assert [name for name in built_from if not (ROOT / name).is_file()] == []


def test_make_targets_exist():
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"(?:`|    )make ([\w-]+)", README))
    assert named
    assert named <= targets


def test_make_help_has_a_line_for_each_target():
    told = subprocess.run(["make", "help"], cwd=ROOT, text=True, capture_output=True, check=True).stdout
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert re.findall(r"^  ([\w-]+): +\w", told, re.MULTILINE) == [target for target in targets if target != "help"]


def test_links_and_folders_exist():
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if not link.startswith("http")]
    folders = re.findall(r"^\| ((?:ros_ws|tools)/\S*) \|", README, re.MULTILINE)
    assert links
    assert folders
    # A link into the page itself names a heading in lower case, with hyphens.
    headings = {"#" + title.lower().replace(" ", "-") for title in re.findall(r"^#+ (.+)$", README, re.MULTILINE)}
    assert [path for path in links + folders if path not in headings and not (ROOT / path).exists()] == []


def test_the_example_table_is_compared_with_the_model(run, table):
    out = run("sandbot_model", "compare", table)
    assert out.startswith("simple model fails: ")
    assert "24 trials in 12 cells (3 volume fractions)" in out
    assert "noise floor" in out


def test_the_example_table_alone_is_enough(run, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(block("phi,omega_rad_s,speed_m_s").split("\n\n")[0] + "\n")
    assert "2 trials in 1 cell (1 volume fraction)" in run("sandbot_model", "compare", path)


@pytest.mark.slow
def test_discover_writes_what_the_readme_says(run, table, tmp_path):
    found, page = tmp_path / "discovery.json", tmp_path / "report.html"
    run("sandbot_model", "discover", table, "--json", found, "--html", page, "--max-effects", 0, "--workers", 1)
    status = json.loads(found.read_text())["verdict"]["status"]
    assert f"| `{status}` |" in README
    assert page.read_text().startswith("<!")


@pytest.mark.slow
def test_the_effect_in_ten_lines_has_ten_lines_and_is_tried(run, table, boost_file, tmp_path):
    code = [line for line in boost_file.read_text().splitlines() if line and not line.startswith("#")]
    assert len(code) <= 10
    out = run("sandbot_model", "compare", table, "--effects", "boost", "--effects-from", boost_file)
    assert "+ boost" in out
    found = tmp_path / "discovery.json"
    few = ("--max-effects", 1, "--workers", 1, "--json", found)
    run("sandbot_model", "discover", table, "--effects-from", boost_file, *few)
    assert "boost" in {candidate["effect"] for candidate in json.loads(found.read_text())["candidates"]}


def test_the_effect_as_a_formula_is_the_one_in_python(run, table, boost_file):
    (formula,) = re.findall(r'`--effect "([^"]+)"`', README)
    run("sandbot_model", "compare", table, "--effects", "boost", "--effect", formula)
    (written,) = effects_in(boost_file)

    def speed(*effects, a=0.5):
        inputs = Inputs(200.0, 15.0, 0.4, 0.62)
        return float(Walker(effects).predict(inputs, [{"a": a}] * len(effects)).speed_m_s)

    assert speed(formula_effect(formula)) == pytest.approx(speed(written), rel=1e-9)
    assert speed(written) > speed() * 1.001
    assert speed(written, a=0.0) == speed()


def test_the_formula_that_was_offered_can_be_added(run, table):
    (formula,) = re.findall(r"--effect '(residual: .*\d)'", README)
    out = run("sandbot_model", "compare", table, "--effects", "residual", "--effect", formula)
    assert "+ residual" in out
    assert "residual.c0" in out


def test_effects_prints_the_catalogue_with_ones_own(run, boost_file):
    assert "boost  [strength]" not in run("sandbot_model", "effects")
    assert "boost  [strength]" in run("sandbot_model", "effects", "--effects-from", boost_file)
