"""What README.md tells a reader to type or to write works as it stands, and every promised command is installed."""

import json
import os
import re
from importlib.metadata import distribution
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")

# Every executable of the design, by package.
EXECUTABLES = {
    "sandbot_clock": ("clock",),
    "sandbot_bed": ("bed",),
    "sandbot_tracking": ("tracker", "camera", "calibrate", "track_video"),
    "sandbot_model": ("predictor", "compare", "discover", "explore", "effects"),
    "sandbot_lab": ("lab",),
    "sandbot_record": ("record", "replay", "recover", "info", "table"),
    "sandbot_bringup": ("campaign", "console", "unseal"),
}
ALL = [(package, name) for package, names in EXECUTABLES.items() for name in names]

# Nodes take ROS arguments only; the others are commands with a --help of their own.
NODES = {"clock", "bed", "tracker", "camera", "predictor", "lab", "console"}
COMMANDS = [(package, name) for package, name in ALL if name not in NODES]

RUNS = [tuple(match) for match in re.findall(r"ros2 run (\w+) (\w+)([^`\n]*)", README)]

# Replicates at two volume fractions, rising with ω as walking speed does.
MORE_ROWS = "".join(
    f"{phi},{omega},{speed + spread:.4f}\n"
    for phi, omega, speed in (
        (0.633, 8, 0.112), (0.633, 12, 0.161), (0.633, 20, 0.229),
        (0.6, 8, 0.109), (0.6, 12, 0.153), (0.6, 16, 0.188), (0.6, 20, 0.206),
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
    text = block("# boost.py").split("\n\nros2 ")[0] + "\n"
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
    for package, name, arguments in RUNS:
        assert (package, name) in ALL
        text = help_of(package, name)
        for option in re.findall(r"--[a-z-]+", arguments):
            assert f"{option} " in text or f"{option}\n" in text or f"{option}]" in text, (name, option)


def test_options_told_in_passing_exist(help_of):
    assert "--dry-run" in help_of("sandbot_bringup", "campaign")
    assert "--effect " in help_of("sandbot_model", "discover")


def test_launch_files_and_their_arguments_exist():
    launches = re.findall(r"ros2 launch (\w+) (\S+)([^`\n]*)", README)
    assert launches
    for package, file, arguments in launches:
        text = (Path(get_package_share_directory(package)) / "launch" / file).read_text()
        for argument in re.findall(r"(\w+):=", arguments):
            assert f'"{argument}"' in text


def test_make_targets_exist():
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"(?:`|    )make ([\w-]+)", README))
    assert named
    assert named <= targets


def test_links_and_folders_exist():
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if not link.startswith("http")]
    folders = re.findall(r"^\| ((?:ros_ws|tools)/\S*) \|", README, re.MULTILINE)
    assert links
    assert folders
    assert [path for path in links + folders if not (ROOT / path).exists()] == []


def test_the_example_table_is_compared_with_the_model(run, table):
    out = run("sandbot_model", "compare", table)
    assert out.startswith("16 trials in 8 cells (2 volume fractions)")
    assert "noise floor" in out


def test_the_example_table_alone_is_enough(run, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(block("phi,omega_rad_s,speed_m_s").split("\n\n")[0] + "\n")
    assert run("sandbot_model", "compare", path).startswith("2 trials in 1 cells")


def test_discover_writes_what_the_readme_says(run, table, tmp_path):
    found, page = tmp_path / "discovery.json", tmp_path / "report.html"
    run("sandbot_model", "discover", table, "--json", found, "--html", page, "--max-effects", 0, "--workers", 1)
    status = json.loads(found.read_text())["verdict"]["status"]
    assert f"| `{status}` |" in README
    assert page.read_text().startswith("<!")


def test_the_effect_in_ten_lines_has_ten_lines_and_is_found(run, table, boost_file):
    code = [line for line in boost_file.read_text().splitlines() if line and not line.startswith("#")]
    assert len(code) <= 10
    out = run("sandbot_model", "compare", table, "--effects", "boost", "--effects-from", boost_file)
    assert "+ boost" in out
    out = run(
        "sandbot_model", "discover", table, "--effects-from", boost_file, "--max-effects", 1, "--workers", 1
    )
    assert re.search(r"^boost +strength ", out, re.MULTILINE)


def test_the_effect_as_a_formula_fits_as_the_one_in_python(run, table, boost_file):
    (formula,) = re.findall(r'`--effect "([^"]+)"`', README)
    steps = []
    for given in (("--effects-from", boost_file), ("--effect", formula)):
        path = table.with_name("steps.json")
        run("sandbot_model", "compare", table, "--effects", "boost", "--json", path, *given)
        steps.append(json.loads(path.read_text())["steps"])
    from_file, from_formula = steps
    assert from_file[1]["rmse"] == pytest.approx(from_formula[1]["rmse"], rel=1e-6)
    # One more parameter can only lower the error of the same cells; that it moves at all shows it is applied.
    assert from_file[1]["rmse"]["speed"] < from_file[0]["rmse"]["speed"]


def test_effects_prints_the_catalogue_with_ones_own(run, boost_file):
    assert "boost  [strength]" not in run("sandbot_model", "effects")
    assert "boost  [strength]" in run("sandbot_model", "effects", "--effects-from", boost_file)
