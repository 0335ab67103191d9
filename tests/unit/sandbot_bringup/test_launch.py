"""The launch file against the least of the real ``launch``: what it declares and what it starts."""

import importlib.util
import sys
from types import ModuleType, SimpleNamespace

import pytest

from sandbot_bringup import node_table
from sandbot_common.errors import InputError


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
    path = node_table.table_path().parents[1] / "launch" / node_table.LAUNCH_FILE
    spec = importlib.util.spec_from_file_location("trackway_launch", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def started(launch_file, *typed, **given):
    (description,) = launch_file.generate_launch_description().args
    function = description[-1].kwargs
    context = SimpleNamespace(launch_configurations={"ros_namespace": "", **given}, argv=list(typed))
    return {one.kwargs["name"]: one.kwargs for one in function["function"](context, *function["args"])}


def test_it_declares_the_table_s_arguments(launch_file):
    (description,) = launch_file.generate_launch_description().args
    declared = {one.args[0]: one.kwargs for one in description[:-1]}
    assert declared["lab"]["default_value"] == "true"
    assert declared["lab"]["choices"] == ["true", "false"]


def test_it_starts_what_the_table_says(launch_file):
    made = started(launch_file, lab="true", **{"bed.pulse_off_s": "0.7"})
    assert made["clock"]["package"] == "sandbot_clock"
    assert made["clock"]["on_exit"]
    assert not made["predictor"]["on_exit"]
    assert made["bed"]["parameters"][0]["pulse_off_s"] == 0.7
    assert "lab" in made
    assert "lab" not in started(launch_file, lab="false")


@pytest.mark.parametrize(
    ("typed", "complaint"),
    [
        ("phii:=0.6", "unknown launch argument 'phii'"),
        ("bed.lease_z:=1", "launch arguments of bed: unknown key 'lease_z', did you mean 'lease_s'?"),
        ("bed.lease_s:=99", r"lease_s: 99 is outside \[0.1, 2\] s"),
        ("lab=false", "malformed launch argument 'lab=false'"),
    ],
)
def test_what_was_typed_wrong_is_refused_in_one_line(launch_file, monkeypatch, typed, complaint):
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "sandbot_bringup", node_table.LAUNCH_FILE, typed])
    with pytest.raises(InputError, match=complaint) as error:
        started(launch_file, typed)
    assert "\n" not in str(error.value)
    # Included in a launch file of somebody else's, what was typed is for that file.
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "theirs", "all.launch.py", typed])
    assert "clock" in started(launch_file, typed)


def test_a_namespace_is_everybody_s(launch_file):
    assert {one["namespace"] for one in started(launch_file, namespace="robot1").values()} == {"/robot1"}
    assert {one["namespace"] for one in started(launch_file).values()} == {None}
