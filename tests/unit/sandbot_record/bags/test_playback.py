import math

import bags
import pytest

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.serialization import to_cdr
from sandbot_record.bags.playback import Player, Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import BagWriter

MS = 1_000_000


@pytest.fixture
def timeline(tmp_path):
    """500 joint states 1 ms apart."""
    return Timeline(Bag.open(bags.legs_bag(tmp_path / "b", compression="zstd", chunk_size=5000)))


def played(player, times_ns):
    """What is published when the player is asked at these times: (time asked, log time since the start in ms)."""
    found = []
    for now in times_ns:
        while (message := player.step(now)) is not None:
            found.append((now, (message.log_time_ns - bags.T0) // MS))
    return found


def test_everything_in_order_and_on_time(timeline):
    player = Player(timeline)
    found = played(player, range(7 * MS, 600 * MS, MS))
    assert found == [((7 + i) * MS, i) for i in range(500)]
    assert player.finished


def test_bytes_are_those_recorded(timeline):
    assert bytes(timeline[123].data) == bags.joint_state(123, bags.T0 + 123 * MS)


def test_messages_out_of_order_in_the_file_are_played_in_order(tmp_path):
    with BagWriter(tmp_path / "b", flush_period_s=0) as writer:
        for i in (3, 1, 2):
            writer.write(topics.LIFT, to_cdr(messages.float64(i)), i)
    assert [message.decode().data for message in Timeline(Bag.open(tmp_path / "b"))] == [1, 2, 3]


def test_rate(timeline):
    found = played(Player(timeline, rate=2.0), range(0, 600 * MS, MS // 2))
    assert found == [(i * MS // 2, i) for i in range(500)]


def test_start_and_until(timeline):
    found = played(Player(timeline, start_s=0.1, until_s=0.2), range(0, 600 * MS, MS))
    assert found == [(i * MS, 100 + i) for i in range(101)]


def test_pause_holds_the_clock(timeline):
    player = Player(timeline)
    assert len(played(player, range(0, 100 * MS, MS))) == 100
    player.pause(True, 99 * MS)
    assert played(player, range(100 * MS, 300 * MS, MS)) == []
    assert player.due_ns() is None
    player.pause(False, 300 * MS)
    assert played(player, [300 * MS, 301 * MS]) == [(301 * MS, 100)]


def test_seek(timeline):
    player = Player(timeline)
    played(player, range(0, 10 * MS, MS))
    player.seek(0.4, 10 * MS)
    assert played(player, [10 * MS, 11 * MS]) == [(10 * MS, 400), (11 * MS, 401)]
    player.seek(-5.0, 11 * MS)
    assert played(player, [11 * MS]) == [(11 * MS, 0)]
    player.seek(99.0, 11 * MS)
    assert played(player, [11 * MS]) == [(11 * MS, 499)]
    for nowhere in (math.nan, math.inf, 1e300):
        with pytest.raises(InputError, match="is not a number of seconds"):
            player.seek(nowhere, 12 * MS)


def test_change_of_rate_on_the_way(timeline):
    player = Player(timeline)
    played(player, range(0, 101 * MS, MS))
    player.set_rate(10.0, 100 * MS)
    assert played(player, [100 * MS, 101 * MS])[-1] == (101 * MS, 110)


def test_loop(timeline):
    player = Player(timeline, loop=True, until_s=0.009)
    found = [index for _, index in played(player, range(0, 30 * MS, MS))]
    assert found[:21] == [*range(10), *range(10), 0]
    assert player.rounds >= 2
    assert not player.finished


def test_a_loop_of_one_topic_takes_as_long_as_its_bag(tmp_path):
    bag = Bag.open(bags.trial_bag(tmp_path / "b"))  # 4.295 s
    led = Timeline(bag, ["/sync_led"])
    found = played(Player(led, loop=True), range(0, 10_000 * MS, MS))
    assert [now // MS for now, _ in found] == [300, 300 + 4295, 300 + 2 * 4295]
    # Its time in the bag remains also where only a part is played.
    found = played(Player(led, loop=True, start_s=0.2, until_s=1.2), range(0, 3000 * MS, MS))
    assert [now // MS for now, _ in found] == [100, 1100, 2100]
    player = Player(led, loop=True)
    player.step(0)
    assert (player.due_ns(), player.step(300 * MS) is None, player.due_ns()) == (300 * MS, False, 4295 * MS)
    assert played(Player(led), range(0, 10_000 * MS, MS)) == [(300 * MS, 300)]


def test_a_part_without_messages_is_refused_unless_something_was_latched(tmp_path):
    bag = Bag.open(bags.trial_bag(tmp_path / "b"))
    with pytest.raises(InputError, match="no messages on these topics in this part of the bag"):
        Player(Timeline(bag, ["/sync_led"]), start_s=0.5)
    assert Player(Timeline(bag, ["/trial"]), start_s=0.5).latched_before_start()


def test_what_has_no_duration_is_not_looped(timeline, tmp_path):
    one = Timeline(Bag.open(bags.legs_bag(tmp_path / "one", count=1)))
    assert played(Player(one), [0, MS]) == [(0, 0)]
    for played_, part in ((one, {}), (timeline, {"start_s": 0.1, "until_s": 0.1}), (timeline, {"start_s": 0.499})):
        with pytest.raises(InputError, match="nothing to loop"):
            Player(played_, loop=True, **part)


def test_topics(tmp_path):
    bag = Bag.open(bags.trial_bag(tmp_path / "b"))
    assert {message.topic for message in Timeline(bag, ["/trial", "/sync_led"])} == {"/trial", "/sync_led"}
    with pytest.raises(InputError, match="no topic /none"):
        Timeline(bag, ["/none"])


def test_refuses(timeline, tmp_path):
    with pytest.raises(InputError, match="rate 0: above 0 is needed"):
        Player(timeline, rate=0)
    with pytest.raises(InputError, match=r"start 1 s, until .* s: the bag has 0 to 0\.499 s"):
        Player(timeline, start_s=1.0)
    with pytest.raises(InputError, match=r"start 0.2 s, until 0.1 s: the bag has 0 to 0.499 s, in this order"):
        Player(timeline, start_s=0.2, until_s=0.1)
    with BagWriter(tmp_path / "empty") as writer:
        writer.add_topic("/x", "std_msgs/msg/String")
    with pytest.raises(InputError, match="nothing to replay"):
        Timeline(Bag.open(tmp_path / "empty"))


def test_a_start_in_the_middle_begins_with_what_was_latched(tmp_path):
    with BagWriter(tmp_path / "b") as writer:
        for i in range(10):
            writer.write(topics.LIFT, to_cdr(messages.float64(i)), bags.T0 + i * 1000 * MS)
            if i in (1, 3, 7):
                writer.write(topics.BED_PHI, to_cdr(messages.float64(i)), bags.T0 + i * 1000 * MS)
    whole = Timeline(Bag.open(tmp_path / "b"))
    kept = Player(whole, start_s=5.0).latched_before_start()
    assert [(message.topic, message.decode().data) for message in kept] == [(topics.BED_PHI.name, 3.0)]
    assert Player(whole).latched_before_start() == []
