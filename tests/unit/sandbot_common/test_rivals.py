from types import SimpleNamespace

import pytest

from sandbot_common import topics
from sandbot_common.neighbours import LOOK_S
from sandbot_common.ros import command_node, node


class Graph:
    """Who publishes, as ROS tells it."""

    def __init__(self, *names):
        self.names, self.looks = list(names), 0

    def count_publishers(self, _):
        self.looks += 1
        return len(self.names)

    def get_publishers_info_by_topic(self, _):
        return [SimpleNamespace(node_name=name) for name in self.names]


@pytest.mark.parametrize(
    ("names", "fault"),
    [
        ([], ""),
        (["clock"], ""),
        (["clock", "clock"], ""),  # a second launch, about to be refused
        (["clock", node.NAMELESS], ""),  # one that was killed, or has just been started
        (["clock", "replay"], "clock and replay both publish /leg_setpoints"),
    ],
)
def test_rivals_are_those_of_another_name(names, fault):
    assert command_node.Rivals(Graph(*names), topics.LEG_SETPOINTS).fault() == fault


def test_of_several_topics_the_one_with_two_publishers_is_named():
    graph = Graph("bed")
    names = {topics.BED_PHI.relative: ["bed", "replay"]}
    graph.count_publishers = lambda name: len(names.get(name, graph.names))
    graph.get_publishers_info_by_topic = lambda name: [SimpleNamespace(node_name=one) for one in names[name]]
    assert command_node.Rivals(graph, topics.BED_STATUS, topics.BED_HEIGHT).fault() == ""
    rivals = command_node.Rivals(graph, *topics.MEASURED)
    assert rivals.fault() == "bed and replay both publish /bed/volume_fraction"


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
