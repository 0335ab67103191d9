"""The layouts shipped for Foxglove and PlotJuggler name what there is: topics, fields, legs, key figures.

That a bag of a live trial holds all of it: test_live_trial.
"""

import json
import re

import pytest
from layouts import TYPES, curves, foxglove, foxglove_panels, plotjuggler, split

from sandbot_bringup.config import config_folder
from sandbot_common import messages, topics

FIGURES = {"tracker": {"lost_frames", "dorsal_dropped", "lateral_dropped"}, "clock": {"missed_deadlines"}}
"""What the nodes tell of themselves, as test_two_cameras and the clock's tests hold it."""


def field(topic, *names):
    """The value of a field of a message of that topic; fails where there is none."""
    value = messages.message_class(TYPES[topic])()
    for name in names:
        value = getattr(value, re.sub(r"\[\d+\]$", "", name))
    return value


# What each panel of Foxglove keeps in a layout: panels/Plot/config.ts, RawMessages/types.ts, diagnostics/util.ts and
# ThreeDeeRender/IRenderer.ts of foxglove/studio (MPL 2.0). Image is ThreeDeeRender in its image mode.
PANELS = {
    "Plot": {"paths": list, "title": str, "showXAxisLabels": bool, "showYAxisLabels": bool, "showLegend": bool,
             "legendDisplay": str, "showPlotValuesInLegend": bool, "isSynced": bool, "xAxisVal": str,
             "followingViewWidth": int, "sidebarDimension": int, "yAxisLabel": str},
    "Image": {"imageMode": dict},
    "RawMessages": {"topicPath": str, "diffEnabled": bool, "diffMethod": str, "diffTopicPath": str,
                    "showFullMessageForDiff": bool},
    "DiagnosticSummary": {"minLevel": int, "topicToRender": str, "pinnedIds": list, "hardwareIdFilter": str,
                          "sortByLevel": bool},
    "3D": {"cameraState": dict, "followTf": str, "followMode": str, "scene": dict, "publish": dict,
           "transforms": dict, "topics": dict, "layers": dict, "imageMode": dict},
}  # fmt: skip
CHOICES = {"legendDisplay": {"floating", "top", "left", "none"}, "diffMethod": {"custom", "previous message"},
           "xAxisVal": {"timestamp", "index", "custom", "currentCustom"},
           "followMode": {"follow-pose", "follow-position", "follow-none"}}  # fmt: skip
SHOWN_IN_3D = {"visualization_msgs/msg/MarkerArray", "geometry_msgs/msg/TransformStamped"}
"""Types that its 3D panel takes, of those published here (ThreeDeeRender/ros.ts)."""


@pytest.mark.parametrize("path", foxglove(), ids=lambda path: path["value"])
def test_foxglove_plots_what_is_published_at_times_that_it_has(path):
    topic, *names = path["value"].split(".")
    field(topic, *names)
    has_stamp = hasattr(messages.message_class(TYPES[topic])(), "header")
    assert path["timestampMethod"] == ("headerStamp" if has_stamp else "receiveTime")


@pytest.mark.parametrize("name", foxglove_panels())
def test_a_panel_keeps_what_foxglove_reads(name):
    panel, known = foxglove_panels()[name], PANELS[name.partition("!")[0]]
    assert {key: type(value) for key, value in panel.items()} == known
    for key, choices in CHOICES.items():
        assert panel.get(key) in {*choices, None}
    for path in panel.get("paths", ()):
        assert set(path) == {"value", "enabled", "timestampMethod", "label"}


def test_foxglove_s_other_panels_show_what_is_published():
    panels = foxglove_panels()
    for name, view in topics.VIEWS.items():
        mode = panels[f"Image!{name}"]["imageMode"]
        assert mode == {"imageTopic": view.image.name, "calibrationTopic": view.info.name}
    assert {TYPES[name] for name in panels["3D!scene"]["topics"]} == SHOWN_IN_3D
    assert panels["3D!scene"]["followTf"] == topics.FRAME
    assert panels["DiagnosticSummary!nodes"]["topicToRender"] == topics.DIAGNOSTICS.name
    topic, *names = panels["RawMessages!trial"]["topicPath"].split(".")
    assert isinstance(field(topic, *names), str)


def test_every_panel_of_foxglove_is_laid_out_once():
    layout = json.loads((config_folder() / "foxglove_layout.json").read_text())

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])


def test_plotjuggler_finds_a_plot_for_every_area_it_splits():
    """As MainWindow, TabbedPlotWidget and PlotDocker::restoreSplitter read it; a count that is off ends PlotJuggler."""
    (root,), (window,) = plotjuggler("root"), plotjuggler("tabbed_widget")
    assert [one.tag for one in root] == ["tabbed_widget", "use_relative_time_offset"]
    assert (window.get("name"), window.get("parent")) == ("Main Window", "main_window")
    assert [one.tag for one in window] == ["Tab", "Tab", "Tab", "currentTabIndex"]
    for container in plotjuggler("Container"):
        assert [one.tag for one in container] == ["DockSplitter"]
    for splitter in plotjuggler("DockSplitter"):
        sizes = [float(size) for size in splitter.get("sizes").split(";")]
        assert splitter.get("orientation") in ("|", "-")
        assert int(splitter.get("count")) == len(splitter) == len(sizes)
        assert sum(sizes) == pytest.approx(1.0, abs=1e-5)
        assert {one.tag for one in splitter} <= {"DockArea", "DockSplitter"}
    for area in plotjuggler("DockArea"):
        assert [one.tag for one in area] == ["plot"]
    for plot in plotjuggler("plot"):
        assert plot.get("mode") == "TimeSeries"
        assert {one.tag for one in plot} == {"range", "limitY", "curve"}


@pytest.mark.parametrize("name", curves())
def test_plotjuggler_plots_what_is_published(name):
    topic, *names = split(name)
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
