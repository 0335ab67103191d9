"""Which topics a recorder looks at: without a graph."""

from types import SimpleNamespace

import pytest

from sandbot_record.tools.recorder_node import Recorder, Selection

TOPICS = ["/talk", "/robot1/talk", "/robot10/talk", "/robot1"]


@pytest.mark.parametrize(("space", "names"), [("/robot1", ["/talk"]), ("", TOPICS)])
def test_all_is_all_of_its_own_namespace(space, names):
    one, looked_at = object.__new__(Recorder), []
    one._space, one._selection, one._by_name = space, Selection(everything=True), {}
    one._receiver, one._recording = SimpleNamespace(broken=False), SimpleNamespace(stopped=SimpleNamespace(is_set=bool))
    one.get_topic_names_and_types = lambda: [(name, ["std_msgs/msg/String"]) for name in TOPICS]
    one._look_at, one._announce = lambda name, _: looked_at.append(name) or False, lambda _: None
    one._look_around()
    assert looked_at == names
