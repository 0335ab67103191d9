from types import SimpleNamespace

import pytest

from sandbot_common import topics
from sandbot_common.neighbours import LOOK_S
from sandbot_common.ros import command_node, endpoints


def endpoint(process, name):
    """A publisher of a node in that process."""
    return SimpleNamespace(node_name=name, endpoint_gid=[process] * 12 + [len(name)] * 4)


class Graph:
    """Who publishes, as ROS tells it: each in a process of its own, all of which report their health but ``silent``."""

    def __init__(self, *names, silent=()):
        self.names, self.looks, self.silent = list(names), 0, silent

    def count_publishers(self, _):
        self.looks += 1
        return len(self.names)

    def get_publishers_info_by_topic(self, topic):
        found = [endpoint(process, name) for process, name in enumerate(self.names)]
        return [one for one in found if topic != "diagnostics" or one.endpoint_gid[0] not in self.silent]


@pytest.mark.parametrize(
    ("names", "fault"),
    [
        ([], ""),
        (["clock"], ""),
        (["clock", "clock"], ""),  # a second launch, about to be refused
        (["clock", endpoints.NAMELESS], ""),  # one that was killed, or has just been started
        (["clock", "replay"], "clock and replay both publish /leg_setpoints"),
    ],
)
def test_rivals_are_those_of_another_name(names, fault):
    assert command_node.Rivals(Graph(*names), topics.LEG_SETPOINTS).fault() == fault


@pytest.mark.parametrize(
    ("names", "silent", "fault"),
    [
        (["clock"], [0], ""),  # a third-party one
        (["clock", "clock"], [1], "two nodes named clock publish /leg_setpoints"),  # a script's node
        (["clock", "clock"], [0, 1], "two nodes named clock publish /leg_setpoints"),
        (["clock", endpoints.NAMELESS], [1], ""),
    ],
)
def test_a_namesake_that_reports_no_health_is_a_rival(monkeypatch, names, silent, fault):
    monkeypatch.setattr(command_node.time, "monotonic", lambda: now_s[0])
    now_s, graph = [1.0], Graph(*names, silent=silent)
    rivals = command_node.Rivals(graph, topics.LEG_SETPOINTS)
    assert not rivals.fault()  # it may be one of ours that has just been started
    now_s[0] += 1.01 * command_node.PASSING_S
    assert rivals.fault() == fault
    graph.silent = ()
    now_s[0] += 1.0
    assert not rivals.fault()
    graph.silent = silent
    now_s[0] += 1.0
    assert not rivals.fault()  # or one that ends


def test_a_node_that_publishes_twice_is_no_second_one():
    graph = Graph("driver", silent=[0])
    graph.count_publishers = lambda _: 2
    graph.get_publishers_info_by_topic = lambda topic: [endpoint(1, "driver")] * 2 if topic != "diagnostics" else []
    assert command_node.Rivals(graph, topics.LEG_SETPOINTS).fault() == ""


def test_of_several_topics_the_one_with_two_publishers_is_named():
    graph = Graph("bed")
    names = {topics.BED_PHI.relative: ["bed", "replay"]}
    graph.count_publishers = lambda name: len(names.get(name, graph.names))
    graph.get_publishers_info_by_topic = lambda name: [endpoint(len(one), one) for one in names[name]]
    assert command_node.Rivals(graph, topics.BED_STATUS, topics.BED_HEIGHT).fault() == ""
    rivals = command_node.Rivals(graph, *topics.MEASURED)
    assert rivals.fault() == "bed and replay both publish /bed/volume_fraction"


@pytest.mark.parametrize("pictures", [topics.DORSAL_IMAGE, topics.LATERAL_JPEG])
def test_two_cameras_of_one_view_are_rivals(pictures):
    """Their pictures were tracked as those of one: a speed a fifth too high, in a row that was ok."""
    graph = Graph("dorsal_camera")
    names = {pictures.relative: ["dorsal_camera", "usb_cam"]}
    graph.count_publishers = lambda name: len(names.get(name, graph.names))
    graph.get_publishers_info_by_topic = lambda name: [endpoint(len(one), one) for one in names[name]]
    rivals = command_node.Rivals(graph, *topics.MEASURED)
    assert rivals.fault() == f"dorsal_camera and usb_cam both publish {pictures.name}"


def test_the_graph_is_not_looked_at_for_every_set_point(monkeypatch):
    now_s = [1.0]
    monkeypatch.setattr(command_node.time, "monotonic", lambda: now_s[0])
    graph = Graph("clock")
    rivals = command_node.Rivals(graph, topics.LEG_SETPOINTS)
    assert [rivals.fault() for _ in range(9)] == [""] * 9
    assert graph.looks == 1
    graph.names.append("replay")
    now_s[0] += 2 * LOOK_S
    assert rivals.fault()
