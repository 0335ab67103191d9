"""Which topics a recorder looks at, and which messages it takes: without a graph."""

import sys
from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message

from sandbot_common import messages, topics
from sandbot_record.nodes.recorder_node import Recorder, Selection, _provenance

TOPICS = ["/talk", "/robot1/talk", "/robot10/talk", "/robot1"]


@pytest.mark.parametrize(("space", "names"), [("/robot1", ["/talk"]), ("", TOPICS)])
def test_all_is_all_of_its_own_namespace(space, names):
    one, looked_at = object.__new__(Recorder), []
    one._space, one._selection, one._by_name = space, Selection(everything=True), {}
    one._receiver, one._recording = SimpleNamespace(broken=False), SimpleNamespace(stopped=SimpleNamespace(is_set=bool))
    one.get_topic_names_and_types = lambda: [(name, ["std_msgs/msg/String"]) for name in TOPICS]
    one._update_source, one._announce = lambda name, _: looked_at.append(name) or False, lambda _: None
    one._poll_graph()
    assert looked_at == names


@pytest.mark.parametrize(("fresh", "kept"), [(True, [103, 98]), (False, [97, 97, 103, 97, 98, 54])])
def test_a_fresh_bag_has_what_its_own_trial_said_whatever_the_clock_of_the_bed(fresh, kept):
    one, put = object.__new__(Recorder), []
    one._start_ns, one._trial, one._fresh_from_ns = 100, b"", sys.maxsize if fresh else 0
    one._recording = SimpleNamespace(put=lambda message, **_: put.append(message.publish_time_ns))
    # What another trial left behind, some of it late; then its own, the φ from a host whose clock is behind.
    for topic, published_ns, received_ns in (
        (topics.TRIAL, 97, 104),
        (topics.BED_PHI, 97, 104),
        (topics.TRIAL, 103, 105),
        (topics.BED_PHI, 97, 106),
        (topics.BED_PHI, 98, 10**10),
        (topics.TRIAL, 54, 10**11),  # of a campaign that was suspended meanwhile
    ):
        source = SimpleNamespace(name=topic.name, transient=True, publishers=0)
        info = {"received_timestamp": received_ns, "source_timestamp": published_ns, "publication_sequence_number": 1}
        one._deliver(source, b"{}", info)
    assert put == kept


def said_on_trial(text):
    return bytes(serialize_message(messages.string(text)))


@pytest.mark.parametrize("last", [b"", said_on_trial(""), said_on_trial("[]"), said_on_trial("{"), b"\x00\x01"])
def test_how_a_trial_ended_is_kept_whatever_somebody_else_has_said_of_it(last):
    assert _provenance(last, "the lab is gone") == {"trial": {"exit_status": "the lab is gone"}}
    assert _provenance(last, "") == {}
    record = _provenance(said_on_trial('{"trial_id": "phi0.6"}'), "the lab is gone")["trial"]
    assert (record["id"], record["exit_status"]) == ("phi0.6", "the lab is gone")


def test_a_recorder_notes_when_the_host_clock_is_set():
    one, noted, steps = object.__new__(Recorder), [], iter([0, 15, 0])
    one._host_clock, one._recording = SimpleNamespace(look=lambda: next(steps)), SimpleNamespace(clock_set=noted.append)
    one._poll_graph = lambda: None
    for _ in range(3):
        one._poll()
    assert noted == [15]
