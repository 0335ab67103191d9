"""The launch file against the least of the real ``launch``: what it declares and what it starts."""

import importlib.util
import sys
from types import ModuleType, SimpleNamespace

import pytest

from sandbot_bringup import nodes


class Recorded:
    def __init__(self, *args, **kwargs):
        self.args, self.kwargs = args, kwargs


@pytest.fixture
def launch_file(monkeypatch):
    names = {
        "launch": ("LaunchContext", "LaunchDescription"),
        "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction", "Shutdown"),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
    }
    for module, classes in names.items():
        fake = ModuleType(module)
        for one in classes:
            setattr(fake, one, type(one, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, module, fake)
    path = nodes.table_path().parents[1] / "launch" / nodes.LAUNCH_FILE
    spec = importlib.util.spec_from_file_location("trackway_launch", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def started(launch_file, **given):
    (description,) = launch_file.generate_launch_description().args
    function = description[-1].kwargs
    context = SimpleNamespace(launch_configurations={"ros_namespace": "", **given})
    return {one.kwargs["name"]: one.kwargs for one in function["function"](context, *function["args"])}


def test_it_declares_the_table_s_arguments(launch_file):
    (description,) = launch_file.generate_launch_description().args
    declared = {one.args[0]: one.kwargs for one in description[:-1]}
    assert declared["lab"]["default_value"] == "true"
    assert declared["lab"]["choices"] == ["true", "false"]


def test_it_starts_what_the_table_says(launch_file):
    made = started(launch_file, lab="true", **{"bed.pulse_off_s": "0.3"})
    assert made["clock"]["package"] == "sandbot_clock"
    assert made["clock"]["on_exit"]
    assert not made["predictor"]["on_exit"]
    assert made["bed"]["parameters"][0]["pulse_off_s"] == 0.3
    assert "lab" in made
    assert "lab" not in started(launch_file, lab="false")
