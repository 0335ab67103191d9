import threading
from collections import deque

import bags
import pytest
from rclpy.parameter import Parameter

from sandbot_common import topics
from sandbot_record.bags.playback import Player, Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import BagWriter
from sandbot_record.nodes import replay_node
from sandbot_record.tools import replay


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--remap /leg_states:=/a/1b", "--remap '/leg_states:=/a/1b' is not /old:=/new"),
        ("--remap /leg_states", "--remap '/leg_states' is not /old:=/new"),
        ("--remap /leg_state:=/a", "--remap /leg_state:=/a: /leg_state is not played, did you mean '/leg_states'?"),
        ("--remap /leg_states:=/a /leg_states:=/b", "--remap /leg_states:=/b: /leg_states is /a already"),
        ("--decode-jpeg", "--decode-jpeg: none of the topics that are played has JPEG frames"),
        ("--ros-args -p rate:=50.0", "--ros-args -p rate: replay is set by options of its own (see --help)"),
    ],
)
def test_what_would_be_ignored_is_refused_in_one_line(tmp_path, domain, capfd, words, said):
    assert replay.main([str(bags.legs_bag(tmp_path / "bag", 3)), *words.split()]) == 2
    error = capfd.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_topics_that_are_played_get_new_names():
    assert replay._remap(["/a:=/b/c_1", "/d:=/e"], ["/a", "/d"]) == {"/a": "/b/c_1", "/d": "/e"}


def test_jpeg_frames_are_known_as_such(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(topics.DORSAL_JPEG, b"", 1)
    bag = Bag.open(tmp_path / "bag")
    assert Timeline(bag, decode_jpeg=True).decoded
    assert not Timeline(bag).decoded


@pytest.mark.parametrize(
    ("played", "watched"),
    [
        (["/lift", "/speed", "/diagnostics"], set()),
        (["/landmarks/com", "/robot1/bed/status"], {"/landmarks/com", "/robot1/bed/status"}),
        (
            ["/a/operator/lease"],
            {"/a/leg_setpoints", "/a/bed/blower", "/a/operator/lease", "/a/leg_states", "/a/bed/height"},
        ),
    ],
)
def test_what_nobody_else_may_publish_is_watched(played, watched):
    assert set(replay_node._live_topics(played)) == watched


@pytest.mark.parametrize(("rate", "position_s", "set_"), [(2.0, 0.002, True), (2.0, 1e10, False), (-1.0, 0.002, False)])
def test_of_two_parameters_both_are_set_or_none(tmp_path, rate, position_s, set_):
    one = object.__new__(replay_node.Replay)
    one._player = player = Player(Timeline(Bag.open(bags.legs_bag(tmp_path / "bag", 5))))
    one._lock, one._changed = threading.Lock(), threading.Event()
    start = player.position_ns(0)
    asked = [Parameter("position_s", value=position_s), Parameter("rate", value=rate)]
    assert one._on_parameters(asked).successful is set_
    assert (player.rate, player.position_ns(0) > start) == ((2.0, True) if set_ else (1.0, False))


@pytest.mark.ros
def test_an_error_of_the_player_ends_the_replay(tmp_path, domain, monkeypatch, capfd):
    command = [str(bags.legs_bag(tmp_path / "bag", 5)), "--delay", "0", "--ros-args", "-r", "__ns:=/replay"]
    assert replay.main(command) == 0  # negative control
    assert capfd.readouterr().out.startswith("replayed 5 messages")

    def failing(_, now):
        raise RuntimeError("not an InputError")

    monkeypatch.setattr(Player, "step", failing)
    with pytest.raises(RuntimeError, match="not an InputError"):
        replay.main(command)


def test_only_the_last_messages_tell_how_late_they_were(monkeypatch):
    one = object.__new__(replay_node.Replay)
    one.published, one.missing, one._late_ns = 5, 0, deque([1_000_000, 3_000_000], maxlen=3)
    assert one.last_line() == "replayed 5 messages; late by 2.000 ms (median), 2.980 (p99), 3.000 (worst)"
    monkeypatch.setattr(replay_node, "_LATE", 2)
    assert one.last_line().endswith("3.000 (worst) of the last 2 messages")
