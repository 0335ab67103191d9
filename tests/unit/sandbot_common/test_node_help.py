"""--help of a node lists its parameters and starts nothing."""

from dataclasses import dataclass
from importlib import import_module

import pytest
import rclpy

from sandbot_common import node
from sandbot_common.errors import InputError
from sandbot_common.parameters import parameter, specs, usage

NODES = {
    "sandbot_clock.clock_node": "ClockParameters",
    "sandbot_bed.bed_node": "BedParameters",
    "sandbot_tracking.tracker_node": "TrackerParameters",
    "sandbot_tracking.camera_node": "CameraParameters",
    "sandbot_model.tools.predictor_node": "PredictorParameters",
    "sandbot_lab.lab_node": "LabParameters",
    "sandbot_bringup.console_node": "ConsoleParameters",
}


@dataclass(frozen=True)
class Fan:
    """Parameters of a fan."""

    rate_hz: float = parameter(5.0, unit="Hz", doc="turns a second", low=0, high=20)
    way: str = parameter("in", doc="where the air goes", choices=("in", "out"))


def refused():
    """Made, and no node after all."""
    raise InputError("the node was made")


def test_usage_says_what_a_parameter_is():
    told = usage("fan", "The fan.\n", Fan)
    assert told.startswith("usage: fan [--ros-args")
    assert "\nThe fan.\n" in told
    assert "  rate_hz\n      turns a second [Hz], 0 to 20 (default: 5.0)" in told
    assert "  way\n      where the air goes; one of in, out (default: 'in')" in told


@pytest.mark.parametrize("asked", ["--help", "-h"])
def test_help_makes_no_node(asked, capsys):
    assert node.run(refused, [asked], parameters=Fan) == 0
    assert capsys.readouterr().out.startswith("usage: ")
    assert not rclpy.ok()


def test_without_it_the_node_is_made(capsys):
    assert node.run(refused, [], parameters=Fan) == 2
    assert "the node was made" in capsys.readouterr().err


@pytest.mark.parametrize("module", NODES)
def test_help_of_every_node_lists_its_parameters(module, capsys):
    found = import_module(module)
    assert found.main(["--help"]) == 0
    told = capsys.readouterr().out
    assert found.__doc__.strip() in told
    for spec in specs(getattr(found, NODES[module])):
        assert f"\n  {spec.name}\n      {spec.doc}" in told
    assert not rclpy.ok()
