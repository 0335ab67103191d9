"""--help of a node lists its parameters and starts nothing."""

from dataclasses import dataclass
from importlib import import_module

import pytest

from sandbot_common import cli
from sandbot_common.parameters import parameter, specs, usage

NODES = {
    "sandbot_clock.clock_parameters": "ClockParameters",
    "sandbot_bed.bed_parameters": "BedParameters",
    "sandbot_tracking.tracker_parameters": "TrackerParameters",
    "sandbot_tracking.camera_parameters": "CameraParameters",
    "sandbot_model.predictor_parameters": "PredictorParameters",
    "sandbot_lab.lab_parameters": "LabParameters",
    "sandbot_bringup.console_parameters": "ConsoleParameters",
    "sandbot_hardware.serial_bed_parameters": "SerialBedParameters",
    "sandbot_hardware.serial_camera_parameters": "SerialCameraParameters",
    "sandbot_hardware.serial_legs_parameters": "SerialLegsParameters",
}


@pytest.mark.parametrize(("module", "name"), NODES.items())
def test_parameters_of_a_node_are_in_the_module_of_their_name(module, name):
    stem = module.rpartition(".")[2]
    assert stem.title().replace("_", "") == name
    assert hasattr(import_module(module), name)


@dataclass(frozen=True)
class Fan:
    """Parameters of a fan."""

    rate_hz: float = parameter(5.0, unit="Hz", doc="turns a second", low=0, high=20)
    way: str = parameter("in", doc="where the air goes", choices=("in", "out"))


@pytest.fixture
def fan(tmp_path, monkeypatch):
    """The command line of a node that says so when it is started."""
    (tmp_path / "fan_node.py").write_text(
        '"""Blows air."""\n\ndef main(argv):\n    print("started", *argv)\n    return 3\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    return cli.node("fan_node", Fan)


def test_usage_says_what_a_parameter_is():
    told = usage("fan", "The fan.\n", Fan)
    assert told.startswith("usage: fan [--ros-args")
    assert "\nThe fan.\n" in told
    assert "  rate_hz\n      turns a second [Hz], 0 to 20 (default: 5.0)" in told
    assert "  way\n      where the air goes; one of in, out (default: 'in')" in told


def test_a_large_integer_limit_is_exact():
    told = usage("lab", "", import_module("sandbot_lab.lab_parameters").LabParameters)
    assert f"0 to {2**62} (default: 1)" in told
    assert "e+" not in told


@pytest.mark.parametrize("asked", ["--help", "-h"])
def test_help_starts_nothing(asked, fan, capsys):
    assert fan([asked]) == 0
    told = capsys.readouterr().out
    assert told.startswith("usage: ")
    assert "Blows air." in told
    assert "started" not in told


@pytest.mark.parametrize("arguments", [[], ["--ros-args", "-p", "rate_hz:=7.0"], ["--ros-args", "-h", "--"]])
def test_without_it_the_node_is_started_with_what_is_ros_s(arguments, fan, capsys):
    assert fan(arguments) == 3
    assert capsys.readouterr().out == " ".join(["started", *arguments]) + "\n"


@pytest.mark.parametrize("arguments", [["rate_hz:=7"], ["--ros-args", "-p", "a:=1", "--", "more"]])
def test_what_is_not_ros_s_is_refused_and_nothing_started(arguments, fan, capsys):
    assert fan(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert f"unknown argument {arguments[-1]!r}; parameters are set with --ros-args -p NAME:=VALUE" in err


@pytest.mark.parametrize("rule", [["-p"], ["-p", "rate_hz=7"], ["-p", "rate_hz:=7", "-r", "/air"], ["-r"]])
def test_a_rule_that_is_none_is_refused_in_one_line_where_ros_would_leave_a_trace(rule, fan, capsys):
    assert fan(["--ros-args", *rule]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.endswith(f"expected {rule[-1 if rule[-1] in ('-p', '-r') else -2]} NAME:=VALUE\n")


@pytest.mark.parametrize("module", NODES)
def test_help_of_every_node_lists_its_parameters(module, capsys):
    found = import_module(module)
    assert found.main(["--help"]) == 0
    told = capsys.readouterr().out
    for spec in specs(getattr(found, NODES[module])):
        assert f"\n  {spec.name}\n      {spec.doc}" in told
    # What it does stands before its parameters.
    assert len(told.split("\n\n")[1]) > 40
