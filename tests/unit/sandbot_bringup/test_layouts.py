"""The layouts shipped for Foxglove and PlotJuggler name what there is: topics, fields, legs, key figures."""

import json
import re
import xml.etree.ElementTree as ElementTree

import pytest

from sandbot_bringup.config import config_folder
from sandbot_common import messages, topics

TYPES = {topic.name: topic.type for topic in topics.ALL}
FIGURES = {"tracker": {"lost_frames", "dorsal_dropped", "lateral_dropped"}, "clock": {"missed_deadlines"}}
"""What the nodes tell of themselves, as test_two_cameras and the clock's tests hold it."""


def field(topic, *names):
    """The value of a field of a message of that topic; fails where there is none."""
    value = messages.message_class(TYPES[topic])()
    for name in names:
        value = getattr(value, re.sub(r"\[\d+\]$", "", name))
    return value


def foxglove():
    panels = json.loads((config_folder() / "foxglove_layout.json").read_text())["configById"]
    return [path for panel in panels.values() for path in panel.get("paths", ())]


def curves():
    return [one.get("name") for one in ElementTree.parse(config_folder() / "plotjuggler_layout.xml").iter("curve")]


@pytest.mark.parametrize("path", foxglove(), ids=lambda path: path["value"])
def test_foxglove_plots_what_is_published_at_times_that_it_has(path):
    topic, *names = path["value"].split(".")
    field(topic, *names)
    has_stamp = hasattr(messages.message_class(TYPES[topic])(), "header")
    assert path["timestampMethod"] == ("headerStamp" if has_stamp else "receiveTime")


def test_every_panel_of_foxglove_is_laid_out_once():
    layout = json.loads((config_folder() / "foxglove_layout.json").read_text())

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])


@pytest.mark.parametrize("name", curves())
def test_plotjuggler_plots_what_is_published(name):
    topic = max((one for one in TYPES if name.startswith(f"{one}/")), key=len)
    names = name.removeprefix(f"{topic}/").split("/")
    if topic == topics.DIAGNOSTICS.name:  # PlotJuggler names these by node and key
        assert names[1] in FIGURES[names[0]]
    elif TYPES[topic] == "sensor_msgs/msg/JointState":  # and these by joint
        assert names[0] in topics.LEGS
        field(topic, names[1])
    else:
        assert isinstance(field(topic, *names), float)


def test_a_field_that_is_not_there_is_found_out():
    with pytest.raises(AttributeError):
        field("/speed", "twist", "linear", "x")
