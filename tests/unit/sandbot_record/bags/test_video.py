import contextlib
import resource
from pathlib import Path

import numpy as np
import pytest
from bags import T0
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.serialization import to_cdr
from sandbot_record.bags import frames, interfaces, metadata, video
from sandbot_record.bags.playback import Timeline
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.recover import recover
from sandbot_record.bags.video import CODECS, VideoFile, VideoFrames, place
from sandbot_record.bags.writer import BagWriter
from sandbot_record.tools.info import main as info
from sandbot_record.trials.film_strip import film_strip

RAW = topics.DORSAL_IMAGE.name
INDEX = video.index_name(RAW)


def noise(count: int, shape=(48, 64), seed: int = 1):
    return np.random.default_rng(seed).integers(0, 256, (count, *shape), dtype=np.uint8)


def image(number: int, pixels) -> bytes:
    return to_cdr(messages.image(T0 + number * 10_000_000, "dorsal", pixels))


def same_image(message, number: int, pixels) -> bool:
    """Whether a decoded Image is the one of this number."""
    right = interfaces.decode(image(number, pixels), frames.RAW)
    told = ("header", "height", "width", "encoding", "is_bigendian", "step")
    return np.array_equal(message.data, right.data) and all(getattr(message, n) == getattr(right, n) for n in told)


def film(path, pixels, codec="rawvideo"):
    """The video of these frames, and their places."""
    file = VideoFile(path, codec)
    found = [place(file.add(image(number, one))) for number, one in enumerate(pixels)]
    file.close()
    return found


def video_bag(path, pixels):
    with BagWriter(path) as writer:
        file = VideoFile(writer.folder / video.file_name(RAW), "rawvideo")
        writer.add_topic(INDEX, video.INDEX, qos=[metadata.qos()])
        for number, one in enumerate(pixels):
            writer.write(INDEX, file.add(image(number, one)), T0 + number * 10_000_000)
        file.close()
    return path


@pytest.mark.parametrize("codec", CODECS)
def test_every_pixel_comes_back_in_any_order(tmp_path, codec):
    pixels = noise(30)
    places = film(tmp_path / "v.avi", pixels, codec)
    frames_back = VideoFrames(tmp_path / "v.avi")
    for number in (*range(30), 3, 4, 29, 0):
        np.testing.assert_array_equal(frames_back.frame(places[number]), pixels[number])
    assert [messages.nanoseconds(one.header.stamp) - T0 for one in places[:3]] == [0, 10_000_000, 20_000_000]
    assert places[0].header.frame_id == "dorsal"
    assert frames_back.codec == codec


@settings(max_examples=15)
@given(st.integers(1, 180), st.integers(2, 180), st.integers(0, 1000), st.sampled_from(sorted(CODECS)))
def test_any_size(tmp_path_factory, rows, columns, seed, codec):
    pixels = noise(3, (rows, columns), seed)
    path = tmp_path_factory.mktemp("v") / "v.avi"
    places = film(path, pixels, codec)
    back = VideoFrames(path)
    np.testing.assert_array_equal([back.frame(one) for one in places], pixels)


def test_what_cannot_become_video_is_refused(tmp_path):
    with pytest.raises(InputError, match="mono8 is needed"):
        VideoFile(tmp_path / "v.avi", "rawvideo").add_pixels(messages.header(0), noise(1, (48, 64, 3))[0])
    with pytest.raises(InputError, match=r"v\.avi: Function not implemented"):
        film(tmp_path / "v.avi", noise(1, (9, 1)), "ffv1")
    file = VideoFile(tmp_path / "w.avi", "rawvideo")
    file.add(image(0, noise(1)[0]))
    with pytest.raises(InputError, match="does not fit"):
        file.add(image(1, noise(1, (50, 64))[0]))
    with pytest.raises(InputError, match="codec 'mjpg' is not one of"):
        VideoFile(tmp_path / "x.avi", "mjpg")
    index = interfaces.store().types[video.INDEX](messages.header(0), messages.stamp(0), "elsewhere")
    with pytest.raises(InputError, match="crc32"):
        place(bytes(interfaces.store().serialize_cdr(index, video.INDEX)))


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("pixels", [np.zeros((480, 640), np.uint8), noise(1, (12, 16))[0]], ids=["dark", "small"])
def test_each_frame_is_in_the_file_at_once(tmp_path, codec, pixels):
    """Of frames that compress to nothing and of small ones, too: 32 KiB of them are otherwise kept in memory."""
    file, path = VideoFile(tmp_path / "v.avi", codec), tmp_path / "v.avi"
    for number in range(40):
        at = place(file.add(image(number, pixels)))
        (tmp_path / "killed.avi").write_bytes(path.read_bytes())
        np.testing.assert_array_equal(VideoFrames(tmp_path / "killed.avi").frame(at), pixels)
    file.close()


@contextlib.contextmanager
def files_of_at_most(size):
    """Files can't grow beyond this size [bytes], as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("codec", CODECS)
def test_the_first_frame_that_does_not_fit_is_refused(tmp_path, codec):
    file, pixels, places = VideoFile(tmp_path / "v.avi", codec), noise(40, (120, 160)), []

    def add_all():
        for number, one in enumerate(pixels):
            places.append(place(file.add(image(number, one))))

    with files_of_at_most(200_000):
        with pytest.raises(InputError, match=r"v\.avi: File too large"):
            add_all()
        file.close()
    assert len(places) in (8, 9, 10)
    back = VideoFrames(tmp_path / "v.avi")
    np.testing.assert_array_equal([back.frame(one) for one in places], pixels[: len(places)])


def test_a_full_disk_is_told():
    with pytest.raises(InputError, match="full: No space left on device"):
        film(Path("/dev/full"), noise(1))


def test_a_flipped_byte_costs_one_frame_and_puts_none_out_of_step(tmp_path):
    pixels = noise(40)
    places = film(tmp_path / "v.avi", pixels)
    whole = (tmp_path / "v.avi").read_bytes()
    draw = np.random.default_rng(2)
    for case in range(60):
        data = bytearray(whole)
        at = int(draw.integers(5000, len(data) - 2000))
        if case % 2:
            data[at] ^= 1 << int(draw.integers(8))
        else:
            del data[at : at + int(draw.integers(1, 3000))]
        (tmp_path / "d.avi").write_bytes(data)
        back, lost = VideoFrames(tmp_path / "d.avi"), 0
        for one, right in zip(places, pixels, strict=True):
            try:
                np.testing.assert_array_equal(back.frame(one), right)
            except InputError:
                lost += 1
        assert lost <= (1 if case % 2 else 2)


def test_a_torn_video_gives_all_frames_before_the_tear(tmp_path):
    pixels = noise(40)
    places = film(tmp_path / "v.avi", pixels)
    data = (tmp_path / "v.avi").read_bytes()
    (tmp_path / "v.avi").write_bytes(data[: len(data) * 3 // 4])
    back = VideoFrames(tmp_path / "v.avi")
    for number in range(28):
        np.testing.assert_array_equal(back.frame(places[number]), pixels[number])
    with pytest.raises(InputError, match="not there"):
        back.frame(places[39])
    with pytest.raises(InputError, match="no such video"):
        VideoFrames(tmp_path / "none.avi").frame(places[0])


def test_replay_gives_the_images_that_were_recorded(tmp_path):
    pixels = noise(12)
    timeline = Timeline(Bag.open(video_bag(tmp_path / "b", pixels)))
    assert list(timeline.topics) == [RAW]
    for number, right in enumerate(pixels):
        message = timeline[number]
        assert (message.topic, message.type) == (RAW, frames.RAW)
        assert same_image(message.decode(), number, right)
    assert len(Timeline(Bag.open(tmp_path / "b"), [RAW])) == 12
    with pytest.raises(InputError, match="no topic"):
        Timeline(Bag.open(tmp_path / "b"), [INDEX])


def test_a_bag_without_its_video_is_not_whole(tmp_path, capsys):
    bag = video_bag(tmp_path / "b", noise(4))
    assert info([str(bag)]) == 0
    assert "4 frames intact, 0 not" in capsys.readouterr().out
    (bag / video.file_name(RAW)).unlink()
    with pytest.raises(InputError, match=r"camera-dorsal-image_raw\.avi is missing"):
        Bag.open(bag)
    assert info([str(bag)]) == 1


def test_recover_takes_over_the_intact_frames(tmp_path, capsys):
    pixels = noise(40)
    bag = video_bag(tmp_path / "b", pixels)
    file = bag / video.file_name(RAW)
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data[: len(data) * 3 // 4])
    assert info([str(bag)]) == 1
    assert "State:             camera-dorsal-image_raw.avi: " in (printed := capsys.readouterr().out)
    assert "missing or damaged" in printed
    result = recover(bag, tmp_path / "r")
    assert 1 <= result.losses[INDEX].count <= 12
    timeline = Timeline(Bag.open(tmp_path / "r"))
    assert len(timeline) == 40 - result.losses[INDEX].count
    for number in range(len(timeline)):
        message = timeline[number]
        index = (message.log_time_ns - T0) // 10_000_000
        assert same_image(message.decode(), index, pixels[index])
    assert info([str(tmp_path / "r")]) == 0


def test_other_topics_called_video_are_just_topics(tmp_path):
    """Negative control: only a TimeReference on <image>/video is a frame index."""
    with BagWriter(tmp_path / "b") as writer:
        writer.add_topic("/news/video", "std_msgs/msg/String", qos=[metadata.qos()])
        writer.write("/news/video", to_cdr(messages.string("x")), T0)
    assert Bag.open(tmp_path / "b").videos == {}
    assert film_strip(tmp_path) == []
