import re
from pathlib import Path

import pytest

from sandbot_common import messages, topics


def test_names_are_unique_and_all_are_listed():
    assert len({topic.name for topic in topics.ALL}) == len(topics.ALL)
    assert topics.LEG_SETPOINTS in topics.ALL
    assert topics.DIAGNOSTICS in topics.ALL


@pytest.mark.parametrize("topic", topics.ALL, ids=lambda topic: topic.name)
def test_every_type_exists_and_every_name_is_absolute(topic):
    assert messages.message_class(topic.type)() is not None
    assert topic.name.startswith("/")


def test_latched_topics_keep_one_message():
    assert {topic.name for topic in topics.ALL if topic.latched} == {"/bed/volume_fraction", "/trial"}
    assert all(topic.depth == 1 for topic in topics.ALL if topic.latched)


def test_tripods_alternate_sides():
    # A tripod is front and rear of one side and the middle of the other.
    assert len(set(topics.LEGS)) == 6
    for tripod in (topics.LEGS[:3], topics.LEGS[3:]):
        front, middle, rear = (leg.split("_")[1] for leg in tripod)
        assert front == rear != middle
        assert [leg.split("_")[0] for leg in tripod] == ["front", "middle", "rear"]


def test_cameras_are_named_in_one_place():
    typed = re.compile(r"""\(["']dorsal["'], ["']lateral["']\)""")
    sources = Path(__file__).parents[3].glob("ros_ws/src/*/*/**/*.py")
    assert [path.name for path in sources if typed.search(path.read_text(encoding="utf-8"))] == []
    assert typed.search(repr(tuple(topics.VIEWS)))
