"""A replay does not command a robot or a bed that is there, unless it is told to, and ends with its bag."""

import os
import subprocess
import sys

import pytest
from processes import ending, running

from sandbot_common import health, messages, topics
from sandbot_common.ros import endpoints
from sandbot_common.serialization import to_cdr
from sandbot_record.bags.writer import BagWriter

pytestmark = [pytest.mark.ros, pytest.mark.timeout(180)]


def command(*arguments, delay_s=3):
    return [sys.executable, "-m", "sandbot_record.tools.replay", *map(str, arguments), "--delay", str(delay_s)]


def replay(*arguments, delay_s=3):
    return subprocess.run(command(*arguments, delay_s=delay_s), capture_output=True, text=True, timeout=60)


def test_commands_are_not_replayed_into_a_live_trackway(tmp_path, beside):
    bag, blown = tmp_path / "b", []
    with BagWriter(bag) as writer:
        for index in range(3):
            writer.write(topics.BED_BLOWER, to_cdr(messages.float64(1.0)), 1_000_000_000 + index)
            writer.write(topics.LIFT, to_cdr(messages.float64(0.0)), 1_000_000_000 + index)
    endpoints.publisher(beside.node, topics.BED_HEIGHT)  # a bed that is there
    endpoints.subscription(beside.node, topics.BED_BLOWER, blown.append)

    # It refuses as soon as the two have met, which takes long on a busy machine.
    refused = replay(bag, delay_s=30)
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "the trackway is live (/bed/height is published)" in refused.stderr
    beside.wait(lambda: blown, 0.2)
    assert not blown

    assert "replayed 3 messages" in replay(bag, "--topics", topics.LIFT.name).stdout

    def insisted():
        # It may be over before a busy machine has let the two meet.
        blown.clear()
        assert "replayed 6 messages" in replay(bag, "--with-commands").stdout
        return beside.wait(lambda: len(blown) == 3, 5.0)

    assert any(insisted() for _ in range(5))


def test_a_second_source_of_what_is_measured_is_refused_and_never_there(tmp_path, beside):
    bag, seen = tmp_path / "b", set()
    with BagWriter(bag) as writer:
        writer.write(topics.COM, to_cdr(messages.point(1, (0.1, 0.0, 0.0))), 1_000_000_000)
    endpoints.publisher(beside.node, topics.COM)  # a tracker that is there

    with ending(subprocess.Popen(command(bag, delay_s=30), stderr=subprocess.PIPE, text=True)) as refused:

        def ended():
            publishers = beside.node.get_publishers_info_by_topic(topics.COM.relative)
            seen.update(endpoints.names_of(publishers))
            return refused.poll() is not None

        beside.until(ended)
        assert "the trackway is live (/landmarks/com is published)" in refused.communicate()[1]
    assert "replay" not in seen  # a campaign would have ended its trial
    assert "replayed 1 message" in replay(bag, "--remap", f"{topics.COM.name}:=/yesterday/com").stdout


def test_a_replay_ends_where_a_trackway_is_switched_on(tmp_path, beside):
    bag, blown = tmp_path / "b", []
    with BagWriter(bag) as writer:
        for index in range(200):
            writer.write(topics.BED_BLOWER, to_cdr(messages.float64(0.0)), 1_000_000_000 + index * 20_000_000)
    endpoints.subscription(beside.node, topics.BED_BLOWER, blown.append)
    playing = subprocess.Popen(command(bag, "--loop", delay_s=0.5), stderr=subprocess.PIPE, text=True)
    with ending(playing):
        beside.until(lambda: len(blown) > 50)  # nobody is there who would obey
        assert playing.poll() is None
        endpoints.publisher(beside.node, topics.BED_HEIGHT)
        _, said = playing.communicate(timeout=60)
        assert playing.returncode == 2
        assert said.count("\n") == 1
        assert "the trackway is live (/bed/height is published)" in said


def test_a_bag_that_is_truncated_while_it_is_replayed_is_one_line(tmp_path, beside):
    bag, heard = tmp_path / "b", []
    with BagWriter(bag, chunk_size=10_000) as writer:
        for index in range(20_000):
            writer.write(topics.LIFT, to_cdr(messages.float64(0.0)), 1_000_000_000 + index * 5_000_000)
    endpoints.subscription(beside.node, topics.LIFT, heard.append)
    playing = subprocess.Popen(command(bag, delay_s=0.5), stderr=subprocess.PIPE, text=True)
    with ending(playing):
        beside.until(lambda: len(heard) > 50)
        assert playing.poll() is None
        os.truncate(bag / "b_0.mcap", 1000)
        _, said = playing.communicate(timeout=60)
    assert playing.returncode == 2
    assert said.count("\n") == 1
    assert "b_0.mcap: was truncated from" in said


def test_what_a_bag_says_of_a_clock_is_no_second_one(beside):
    told = []
    endpoints.subscription(
        beside.node, topics.DIAGNOSTICS, lambda message: told.extend(s for s in message.status if s.name == "clock")
    )
    bag = endpoints.publisher(beside.node, topics.DIAGNOSTICS)
    with running("sandbot_clock.nodes.clock_node") as clock:
        beside.until(lambda: told and bag.get_subscription_count() > 1)
        recorded = messages.diagnostics(1, "clock", {"since_ns": 1, "process": "elsewhere/1 5 6"})
        for _ in range(5):
            bag.publish(recorded)
            told.clear()
            beside.until(lambda: sum(health.PROCESS in [p.key for p in s.values] for s in told) >= 2)  # it lives on
        assert clock.poll() is None
