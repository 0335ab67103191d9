import errno
import itertools
import math
import os
import shutil
import threading
import time

import bags
import numpy as np
import pytest
from mcap.reader import make_reader

from sandbot_common import messages
from sandbot_common.errors import InputError
from sandbot_common.serialization import to_cdr
from sandbot_record.bags import interfaces
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.recording import Limits, Received, Recording
from sandbot_record.bags.writer import BagWriter

KIND = "sensor_msgs/msg/JointState"


def recording(path, **options):
    writer = BagWriter(path, whole=False, flush_period_s=0, chunk_size=20_000)
    options = {"limits": Limits(min_free=0), "monotonic_s": time.monotonic, **options}
    made = Recording(writer, **options)
    made.add_topic("/x", KIND)
    return made


def put(made, indices, sole_publisher=True):
    for i in indices:
        made.put(Received("/x", bags.joint_state(i, i), bags.T0 + i, bags.T0 + i - 1, i), sole_publisher=sole_publisher)


def test_everything_put_is_in_the_bag(tmp_path):
    made = recording(tmp_path / "b")
    put(made, range(1, 301))
    made.close({"trial": {"id": "t1"}})
    bag = Bag.open(tmp_path / "b")
    assert [m.sequence for m in bag.messages()] == list(range(1, 301))
    assert bag.provenance["trial"] == {"exit_status": "ok", "id": "t1"}
    assert bag.provenance["recording"]["/x"] == "written 300, lost 0, dropped 0"
    assert made.last_line().endswith("0 lost")


def test_gaps_in_the_sequence_are_counted(tmp_path):
    made = recording(tmp_path / "b")
    put(made, [5, 6, 9, 10, 1, 2])  # 7 and 8 are missing; then the publisher was started anew
    made.close()
    assert made.lost == 2
    assert "2 lost (/x 2)" in made.last_line()


def test_what_the_middleware_lost_is_not_counted_twice(tmp_path):
    made = recording(tmp_path / "b")
    put(made, [1, 2, 5])
    made.lose("/x", 2)  # the same two
    assert made.lost == 2
    made.lose("/x", 3)  # and three that left no gap
    made.close()
    assert "5 lost (/x 5)" in made.last_line()
    assert Bag.open(tmp_path / "b").provenance["recording"]["/x"] == "written 3, lost 5, dropped 0"


def test_what_was_sent_before_the_first_message_is_not_lost(tmp_path):
    made = recording(tmp_path / "b")
    made.lose("/x", 49)
    put(made, [50])
    assert made.lost == 49  # nothing speaks against it yet
    put(made, [51, 53])
    assert made.lost == 1
    made.lose("/x", 4)  # no message after it: these may be true
    made.close()
    assert made.lost == 4


def test_a_topic_that_cannot_be_recorded_makes_it_incomplete(tmp_path):
    made = recording(tmp_path / "b")
    put(made, [1, 2])
    made.refuse("/y", "its type is not installed")
    made.close({"trial": {"id": "t"}})
    assert "1 topic not recorded (/y)" in made.last_line()
    told = Bag.open(tmp_path / "b").provenance
    assert told["recording"]["exit_status"] == "incomplete, not recorded: /y"
    assert told["recording"]["/y"] == "not recorded: its type is not installed"
    assert told["trial"]["exit_status"] == "ok"  # what it needs is there, or `table` will say what is not


def test_several_publishers_have_no_common_sequence(tmp_path):
    made = recording(tmp_path / "b")
    put(made, [5, 900, 6, 901], sole_publisher=False)
    assert made.lost == 0
    put(made, [7, 8])  # the other one has gone
    assert made.lost == 0
    made.lose("/x", 3)
    put(made, [902], sole_publisher=False)
    put(made, [9, 11])
    made.close()
    assert made.lost == 4


def test_a_full_queue_drops_and_counts(tmp_path):
    made = recording(tmp_path / "b", limits=Limits(min_free=0, queue_bytes=10))
    put(made, range(1, 11))
    made.close()
    assert (made.written, made.lost) == (0, 10)
    assert Bag.open(tmp_path / "b").provenance["recording"]["/x"] == "written 0, lost 0, dropped 10"


def test_paused_messages_are_neither_written_nor_lost(tmp_path):
    made = recording(tmp_path / "b")
    put(made, [1, 2])
    made.pause(True, 7)
    put(made, [3, 4])
    made.pause(False, 9)
    made.pause(False, 10)  # no pause ends twice
    put(made, [5])
    made.pause(True, 20)
    made.close()
    assert (made.written, made.lost) == (3, 0)
    assert Bag.open(tmp_path / "b").provenance["recording"]["paused"] == "7 to 9, 20 to end"


@pytest.mark.parametrize(("steps_ns", "noted"), [([], None), ([15 * 10**9, -2_000_000], "+15.000000, -0.002000")])
def test_steps_of_the_host_clock_are_noted(tmp_path, steps_ns, noted):
    made = recording(tmp_path / "b")
    for step_ns in steps_ns:
        made.clock_set(step_ns)
    made.close()
    assert Bag.open(tmp_path / "b").provenance["recording"].get("clock_set_s") == noted


def test_paused_images_leave_the_rest_as_it_is(tmp_path):
    made = recording(tmp_path / "b", images="raw", images_paused=True)
    made.add_topic("/image", "sensor_msgs/msg/Image")
    frame = to_cdr(messages.image(bags.T0, "c", np.zeros((4, 4), np.uint8)))
    for i in (1, 2, 3):
        made.images_paused = i < 2
        made.put(Received("/image", frame, bags.T0 + i, bags.T0 + i, i))
        put(made, [i])
    made.close()
    assert made.lost == 0
    kept = [(message.topic, message.sequence) for message in Bag.open(tmp_path / "b").messages()]
    assert sorted(kept) == [("/image", 2), ("/image", 3), ("/x", 1), ("/x", 2), ("/x", 3)]


def test_stops_when_space_runs_out(tmp_path):
    free = iter([1000, 1000, 5])
    made = recording(
        tmp_path / "b", limits=Limits(min_free=100), free_bytes=lambda _: next(free, 5), flush_period_s=0.01
    )
    put(made, range(1, 5))
    assert made.stopped.wait(10)
    made.close()
    assert made.failed
    assert "--min-free" in made.last_line()
    assert Bag.open(tmp_path / "b").count == made.written


def test_refuses_to_begin_without_space(tmp_path):
    with pytest.raises(InputError, match="only 0 MiB free"):
        recording(tmp_path / "b", limits=Limits(min_free=100), free_bytes=lambda _: 5)


def test_stops_after_its_duration(tmp_path):
    made = recording(tmp_path / "b", limits=Limits(min_free=0, duration_s=0.05))
    assert made.stopped.wait(10)
    made.close()
    assert not made.failed


def full_at(monkeypatch, room: int) -> None:
    """A disk on which each file has room for so many bytes."""
    real = os.writev

    def writev(fd, parts):
        size = os.lseek(fd, 0, os.SEEK_CUR)
        data = b"".join(parts)[: max(0, room - size)]
        if not data:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(fd, [data])

    monkeypatch.setattr(os, "writev", writev)


@pytest.mark.timeout(30)
@pytest.mark.parametrize("room", range(150_000, 200_000, 7_001))
def test_a_summary_larger_than_a_chunk_finds_room_too(tmp_path, monkeypatch, room):
    """Twenty topics: what their definitions need at the end is more than the last chunk leaves free."""
    full_at(monkeypatch, room)
    made = recording(tmp_path / "b")
    for number in range(20):
        made.add_topic(f"/y{number}", "diagnostic_msgs/msg/DiagnosticArray")
        made.add_topic(f"/z{number}", "sensor_msgs/msg/CameraInfo")
    put(made, range(1, 1001))
    assert made.stopped.wait(10)
    made.close({"trial": {"id": "t"}})
    monkeypatch.undo()
    bag = Bag.open(tmp_path / "b")
    assert [m.sequence for m in bag.messages()] == list(range(1, bag.count + 1))
    assert bag.count > 100
    assert bag.provenance["trial"]["exit_status"].startswith("No space left")
    assert made.written == bag.count


@pytest.mark.timeout(30)
def test_where_not_even_the_summary_fits_the_bag_is_left_as_it_is(tmp_path, monkeypatch):
    full_at(monkeypatch, 1_500)
    made = recording(tmp_path / "b")
    put(made, range(1, 101))
    assert made.stopped.wait(10)
    made.close()
    monkeypatch.undo()
    assert made.failed
    assert "No space left" in made.last_line()
    assert not Bag.open(tmp_path / "b", strict=False).complete


@pytest.mark.parametrize("room", [15_000, 30_000, 50_000, 51_000])
def test_a_full_disk_closes_the_bag_with_what_fitted(tmp_path, monkeypatch, room):
    full_at(monkeypatch, room)
    made = recording(tmp_path / "b")
    put(made, range(1, 501))
    made.stopped.wait(0.5)
    made.close()
    monkeypatch.undo()
    assert made.failed
    assert "No space left on device" in made.last_line()
    bag = Bag.open(tmp_path / "b")
    assert bag.complete
    assert [m.sequence for m in bag.messages()] == list(range(1, bag.count + 1))
    assert bag.provenance["recording"]["exit_status"].startswith("No space left")


def test_a_full_disk_is_told_before_a_chunk_is_full(tmp_path, monkeypatch):
    """Legs may be moving: one small message is enough, nobody waits for the next."""
    told = threading.Event()
    made = recording(tmp_path / "b", flush_period_s=0.01)
    made.on_stop = told.set
    put(made, [1])
    assert not told.wait(0.1)  # there is room
    full_at(monkeypatch, 0)
    put(made, [2])
    assert told.wait(10)
    assert "No space left" in made.reason
    made.close()


@pytest.mark.parametrize("what", ["renamed", "deleted", "its folder deleted"])
def test_a_bag_that_is_no_longer_there_is_told_at_once_and_not_made_anew(tmp_path, what):
    """The report of it has figures of a disk that may be gone; it must come out all the same."""
    told, path = threading.Event(), tmp_path / "campaign" / "b"
    made = recording(path, flush_period_s=0.01)
    made.on_stop = told.set
    put(made, [1])
    assert not told.wait(0.1)  # it is there
    if what == "renamed":
        path.rename(tmp_path / "campaign" / "mine")
    else:
        shutil.rmtree(path if what == "deleted" else path.parent)
    assert told.wait(10)
    assert made.failed
    assert made.reason == f"{path}: renamed or deleted while it was written"
    assert math.isfinite(made.free_bytes) == path.parent.exists()
    assert made.size_bytes == 0
    made.add_topic("/y", KIND)
    made.close({"trial": {"id": "t1"}})
    assert not path.exists()
    if what == "renamed":  # its file is complete
        with (tmp_path / "campaign" / "mine" / "b_0.mcap").open("rb") as file:
            assert make_reader(file).get_summary().statistics.message_count == 1


def test_what_waits_is_flushed_while_more_comes(tmp_path):
    """A second passes between any two looks at this clock: each message is on the disk before the next."""
    seconds = itertools.count()
    made = recording(tmp_path / "b", monotonic_s=lambda: next(seconds))
    put(made, range(1, 51))
    made.close()
    with (tmp_path / "b" / "b_0.mcap").open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    assert len(chunks) == 50


@pytest.mark.parametrize("registered_again", [False, True])
def test_images_become_a_video(tmp_path, registered_again):
    """Also if the topic is registered again meanwhile, as after a change of its publisher's QoS."""
    pixels = np.random.default_rng(1).integers(0, 256, (6, 48, 64), dtype=np.uint8)
    made = Recording(
        BagWriter(tmp_path / "b", whole=False), limits=Limits(min_free=0), images="video", monotonic_s=time.monotonic
    )
    made.add_topic("/cam", "sensor_msgs/msg/Image")
    for index, one in enumerate(pixels):
        if registered_again and index == 3:
            while made.written < 3:
                assert not made.stopped.wait(0.01)
            made.add_topic("/cam", "sensor_msgs/msg/Image")
        image = to_cdr(messages.image(index, "cam", one))
        made.put(Received("/cam", image, bags.T0 + index, bags.T0 + index, index + 1))
    made.close()
    assert made.last_line().startswith("recorded 6 messages of 1 topic to ")
    timeline = Timeline(Bag.open(tmp_path / "b"))
    for index, one in enumerate(pixels):
        image = timeline[index].decode()
        assert image.header.stamp.nanosec == index
        np.testing.assert_array_equal(image.data.reshape(48, 64), one)


def test_a_topic_registered_again_with_another_type_ends_the_recording(tmp_path):
    made = recording(tmp_path / "b")
    made.add_topic("/x", "std_msgs/msg/Bool")
    assert made.stopped.wait(10)
    made.close()
    assert "not std_msgs/msg/Bool" in made.reason


def test_a_topic_that_appears_while_the_disk_stands_still_is_recorded(tmp_path):
    made = recording(tmp_path / "b")
    writing, goes_on = threading.Event(), threading.Event()

    def stand_still(data):
        writing.set()
        assert goes_on.wait(10)
        return data

    made._convert["/x"] = stand_still
    put(made, [1, 2])
    assert writing.wait(10)
    made.add_topic("/late", KIND)
    made.put(Received("/late", bags.joint_state(3, 3), bags.T0 + 3, bags.T0 + 3, 1))
    goes_on.set()
    made.close()
    assert made.last_line().startswith("recorded 3 messages of 2 topics to ")
    assert not made.failed


def test_an_image_that_cannot_become_a_video_stops_with_the_reason(tmp_path):
    made = Recording(
        BagWriter(tmp_path / "b", whole=False), limits=Limits(min_free=0), images="video", monotonic_s=time.monotonic
    )
    made.add_topic("/cam", "sensor_msgs/msg/Image")
    coloured = messages.image(0, "cam", np.zeros((48, 3 * 64), np.uint8))
    coloured.encoding, coloured.width = "bgr8", 64
    made.put(Received("/cam", to_cdr(coloured), bags.T0, bags.T0, 1))
    assert made.stopped.wait(10)
    made.close()
    assert made.failed
    assert "mono8 is needed" in made.last_line()


@pytest.mark.parametrize("images", ["jpeg", "video"])
def test_an_empty_image_stops_with_the_reason(tmp_path, images):
    writer = BagWriter(tmp_path / "b", whole=False)
    made = Recording(writer, limits=Limits(min_free=0), images=images, monotonic_s=time.monotonic)
    made.add_topic("/cam", "sensor_msgs/msg/Image")
    made.put(Received("/cam", to_cdr(messages.image(0, "cam", np.zeros((0, 0), np.uint8))), bags.T0, bags.T0, 1))
    assert made.stopped.wait(10)
    made.close()
    assert made.failed
    assert "an image of 0 x 0 pixels can't become" in Bag.open(tmp_path / "b").provenance["recording"]["exit_status"]


def test_a_fault_of_the_writers_own_is_told_in_the_bag(tmp_path):
    made = recording(tmp_path / "b")
    made._convert["/x"] = lambda _: 1 // 0
    put(made, [1])
    assert made.stopped.wait(10)
    made.close()
    assert made.failed
    assert Bag.open(tmp_path / "b").provenance["recording"]["exit_status"].startswith("ZeroDivisionError: ")


def test_half_a_character_of_a_trial_does_not_prevent_closing(tmp_path):
    made = recording(tmp_path / "b")
    made.close({"trial": {"id": "t\ud800", "plan": "φ"}})
    trial = Bag.open(tmp_path / "b").provenance["trial"]
    assert (trial["id"], trial["plan"]) == ("t\\ud800", "φ")


def test_images_become_jpeg(tmp_path):
    pixels = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))
    writer = BagWriter(tmp_path / "b", whole=False)
    made = Recording(writer, limits=Limits(min_free=0), images="jpeg", monotonic_s=time.monotonic)
    made.add_topic("/cam", "sensor_msgs/msg/Image")
    made.put(Received("/cam", to_cdr(messages.image(7, "cam", pixels)), bags.T0, bags.T0, 1))
    made.close()
    import cv2

    (message,) = Bag.open(tmp_path / "b").messages(["/cam/compressed"])
    image = interfaces.decode(bytes(message.data), message.type)
    assert image.header.stamp.nanosec == 7
    decoded = cv2.imdecode(np.asarray(image.data), cv2.IMREAD_GRAYSCALE)
    assert np.abs(decoded.astype(int) - pixels).max() < 12


def test_a_file_that_is_renamed_meanwhile_is_no_fault(tmp_path, monkeypatch):
    """metadata.yaml is written beside and renamed while somebody asks for the bag's size."""
    made = recording(tmp_path / "b")
    before = made.size_bytes
    listed = [*(tmp_path / "b").iterdir(), tmp_path / "b" / ".metadata.yaml"]
    monkeypatch.setattr(type(tmp_path), "glob", lambda self, pattern: iter(listed))
    assert made.size_bytes == before
    made.close({})
