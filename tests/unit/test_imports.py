"""What comes along with an import: nobody who reads a bag or fits a model waits for ROS, Dash or OpenCV."""

import subprocess
import sys

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


def test_no_analysis_import_loads_ros_dash_or_opencv():
    assert loaded(*ANALYSIS).isdisjoint(HEAVY)


def test_what_is_heavy_would_be_seen():
    assert "cv2" in loaded("sandbot_tracking.markers")


def test_a_door_costs_nothing_until_it_is_used():
    seen = loaded("sandbot_record", "sandbot_tracking", "sandbot_model", "sandbot_common")
    assert seen.isdisjoint({*HEAVY, "numpy", "yaml", "scipy", "rosbags"})


HELPED = """
import sys
from importlib import import_module
try:
    import_module(sys.argv[1]).main(["--help"])
except SystemExit:
    print(*sys.modules)
"""


@pytest.mark.parametrize(
    "command",
    [
        "sandbot_model.tools.compare",
        "sandbot_model.tools.discover",
        "sandbot_model.tools.effects",
        "sandbot_model.tools.explore",
        "sandbot_tracking.tools.track_video",
    ],
)
def test_help_does_not_wait_for_what_computes(command):
    told = subprocess.run([sys.executable, "-c", HELPED, command], capture_output=True, text=True, check=True).stdout
    assert told.startswith("usage: ")
    assert set(told.split()).isdisjoint({*HEAVY, "scipy", "flask", "rosbags"})


@pytest.mark.parametrize("package", [sandbot_model, sandbot_record, sandbot_tracking])
def test_every_name_of_a_door_is_there(package):
    assert sorted(package.__all__) == dir(package)
    for name in package.__all__:
        assert callable(getattr(package, name))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        package.nothing  # noqa: B018
