"""What comes along with an import: nobody who reads a bag or fits a model waits for ROS, Dash or OpenCV."""

import re
import subprocess
import sys
from pathlib import Path

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


def test_a_door_costs_nothing_until_it_is_used():
    seen = loaded("sandbot_record", "sandbot_tracking", "sandbot_model", "sandbot_common")
    assert seen.isdisjoint({*HEAVY, "numpy", "yaml", "scipy", "rosbags"})


STARTED = """
import sys
from importlib import import_module
try:
    import_module(sys.argv[1]).main(sys.argv[2:])
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
    for arguments, said in ((["--help"], "usage: "), (["--no-such-option", "x"], ": error: ")):
        told = subprocess.run(
            [sys.executable, "-c", STARTED, COMMANDS[command], *arguments], capture_output=True, text=True, check=True
        )
        before, _, modules = told.stdout.rpartition("loaded:")
        assert said in before + told.stderr
        assert len(told.stderr.splitlines()) <= 1
        assert set(modules.split()).isdisjoint(SLOW)


@pytest.mark.parametrize("package", [sandbot_model, sandbot_record, sandbot_tracking])
def test_every_name_of_a_door_is_there(package):
    assert sorted(package.__all__) == dir(package)
    for name in package.__all__:
        assert callable(getattr(package, name))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        package.nothing  # noqa: B018
