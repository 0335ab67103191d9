"""What comes along with an import: nobody who reads a bag or fits a model waits for ROS, Dash or OpenCV."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

import sandbot_model
import sandbot_record
import sandbot_tracking

ANALYSIS = (
    "sandbot_model",
    "sandbot_model.physics.walking",
    "sandbot_model.physics.catalogue",
    "sandbot_model.physics.predictor",
    "sandbot_model.data.conditions",
    "sandbot_model.fitting.fit",
    "sandbot_model.fitting.bootstrap",
    "sandbot_model.discovery.discover",
    "sandbot_model.report",
    "sandbot_model.tools.compare",
    "sandbot_model.tools.discover",
    "sandbot_model.tools.effects",
    "sandbot_record.bags.reader",
    "sandbot_record.bags.writer",
    "sandbot_record.trials.read",
    "sandbot_record.tools.info",
    "sandbot_record.tools.table",
    "sandbot_tracking.trial",
    "sandbot_tracking.calibration",
)
HEAVY = ("rclpy", "sensor_msgs", "dash", "cv2", "pandas", "scipy.stats", "numba", "sandbot_lab")
SEEN = """
import sys
from importlib import import_module
for name in sys.argv[1].split():
    import_module(name)
print(*sys.modules)
"""


def loaded(*names: str) -> set[str]:
    command = [sys.executable, "-c", SEEN, " ".join(names)]
    return set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.slow
def test_no_analysis_import_loads_ros_dash_or_opencv():
    assert loaded(*ANALYSIS).isdisjoint(HEAVY)


def test_what_is_heavy_would_be_seen():
    assert "cv2" in loaded("sandbot_tracking.source")


def test_public_names_cost_nothing_until_they_are_used():
    seen = loaded("sandbot_record", "sandbot_tracking", "sandbot_model", "sandbot_common")
    assert seen.isdisjoint({*HEAVY, "numpy", "yaml", "scipy", "rosbags"})


STARTED = """
import sys
from importlib import import_module
for arguments in (["--help"], ["--no-such-option", "x"]):
    try:
        import_module(sys.argv[1]).main(arguments)
    except SystemExit:
        pass
print("loaded:", *sys.modules)
"""
ROOT = Path(__file__).parents[2]
COMMANDS = {
    name: module
    for setup in sorted(ROOT.glob("ros_ws/src/*/setup.py"))
    for name, module in re.findall(r'"(\w+) = ([\w.]+):main"', setup.read_text(encoding="utf-8"))
}
SLOW = {
    "rclpy",
    "sensor_msgs",
    "dash",
    "flask",
    "plotly",
    "matplotlib",
    "cv2",
    "pandas",
    "scipy",
    "numba",
    "av",
    "rerun",
}
"""What costs a tenth of a second and more to import; counted, because times hang on the machine."""


def test_every_command_is_looked_at():
    assert {"clock", "tracker", "campaign", "compare", "record", "simulate"} <= COMMANDS.keys()
    assert len(COMMANDS) > 20


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_help_and_a_slip_do_not_wait_for_what_computes(command):
    started = [sys.executable, "-c", STARTED, COMMANDS[command]]
    told = subprocess.run(started, capture_output=True, text=True, check=True)
    before, _, modules = told.stdout.rpartition("loaded:")
    for said in ("usage: ", ": error: "):
        assert said in before + told.stderr
    assert len(told.stderr.splitlines()) <= 1
    assert set(modules.split()).isdisjoint(SLOW)


@pytest.mark.parametrize("package", [sandbot_model, sandbot_record, sandbot_tracking])
def test_every_public_name_is_there(package):
    assert sorted(package.__all__) == dir(package)
    for name in package.__all__:
        assert callable(getattr(package, name))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        package.nothing  # noqa: B018


PACKAGES = sorted(path.parent.name for path in ROOT.glob("ros_ws/src/*/setup.py"))
ARROW = re.compile(r"^ {4}sandbot_(\w+) .*← (.+)$", flags=re.MULTILINE)


def packages_imported(package: str, graph: grimp.ImportGraph) -> set[str]:
    own = {package, *graph.find_descendants(package)}
    seen = {name.partition(".")[0] for module in own for name in graph.find_modules_directly_imported_by(module)}
    return seen & set(PACKAGES) - {package}


def differing(page: str, graph: grimp.ImportGraph) -> set[str]:
    """Packages whose imports are not those of the page's table."""
    rows = dict(ARROW.findall(page))
    rows["bringup"] = ", ".join(rows.keys() - {"bringup", *rows["bringup"].removeprefix("all but ").split(", ")})
    stated = {
        f"sandbot_{name}": {f"sandbot_{one}" for one in re.sub(r" \(.*?\)|nothing", "", row).split(", ") if one}
        for name, row in rows.items()
    }
    return {name for name in PACKAGES if packages_imported(name, graph) != stated.get(name)}


def test_packages_import_what_the_table_of_architecture_says():
    graph = grimp.build_graph(*PACKAGES, cache_dir=str(ROOT / ".import_linter_cache"))
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert differing(page, graph) == set()
    assert differing(page.replace("common, clock (gait)", "common, clock, bed"), graph) == {"sandbot_lab"}
    assert differing(page.replace("all but hardware", "all but clock"), graph) == {"sandbot_bringup"}


def without_a_word(folder: Path) -> set[str]:
    """Modules that neither their package's docstring nor that of the one above names; parameters are their node's."""
    maps = " ".join(ast.get_docstring(ast.parse(one.read_text(encoding="utf-8"))) or "" for one in (
        path / "__init__.py" for path in (folder, folder.parent)) if one.is_file())  # fmt: skip
    modules = {path.stem for path in folder.glob("*.py") if not path.stem.endswith(("__init__", "_parameters"))}
    return modules - set(re.findall(r"\w+", maps))


@pytest.mark.parametrize("package", PACKAGES)
def test_the_docstring_of_a_package_names_every_module(package):
    folders = [path.parent for path in (ROOT / "ros_ws" / "src" / package / package).rglob("__init__.py")]
    assert {one.name: missing for one in folders if one.name != "effects" and (missing := without_a_word(one))} == {}


def test_a_module_that_no_map_names_is_found(tmp_path):
    (tmp_path / "__init__.py").write_text('"""A package.\n\nhere  is named\n"""\n', encoding="utf-8")
    for name in ("here", "absent", "node_parameters"):
        (tmp_path / f"{name}.py").touch()
    assert without_a_word(tmp_path) == {"absent"}
