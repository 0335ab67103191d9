"""A trial's film: from frames of any kind, to any thread, and none where no lateral camera is known."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import yaml
from bags import T0

from sandbot_bringup.config import config_folder
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.serialization import to_cdr
from sandbot_common.yaml_text import read_yaml
from sandbot_record.bags import frames, video
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import BagWriter
from sandbot_record.trials import film_strip
from sandbot_record.trials.film import film_of

CAMERAS = read_yaml(config_folder() / "cameras.yaml")
RAW = topics.LATERAL_IMAGE.name
INDEX = topics.Topic(video.index_name(RAW), video.INDEX)


def filmed(path, count=8, *, cameras=CAMERAS, as_video=False):
    """A bag with frames of noise, and the axles at the origin."""
    noise = np.random.default_rng(1).integers(0, 256, (count, 120, 160), dtype=np.uint8)
    with BagWriter(path) as writer:
        writer.write(topics.SYNC_LED, to_cdr(messages.header(T0, "sync_led")), T0)
        file = video.VideoFile(writer.folder / video.file_name(RAW), "rawvideo") if as_video else None
        for number, pixels in enumerate(noise):
            t_ns = T0 + number * 10_000_000
            if file is None:
                writer.write(topics.LATERAL_JPEG, to_cdr(messages.jpeg(t_ns, "l", frames.encode_jpeg(pixels))), t_ns)
            else:
                writer.write(INDEX, file.add(to_cdr(messages.image(t_ns, "l", pixels))), t_ns)
            for axle in (topics.FRONT_AXLE, topics.REAR_AXLE):
                writer.write(axle, to_cdr(messages.point(t_ns, (0.0, 0.0, 0.0))), t_ns)
        if file is not None:
            file.close()
        if cameras is not None:
            text = cameras if isinstance(cameras, bytes) else yaml.safe_dump(cameras).encode()
            writer.attach("cameras.yaml", text, "application/yaml")
    return path


@pytest.mark.parametrize("as_video", [True, False])
def test_any_thread_may_ask_for_any_frame(tmp_path, as_video):
    """Without a lock, threads that share a video's decoder abort the process."""
    bag = Bag.open(filmed(tmp_path / "b", 60, as_video=as_video))
    alone, film = film_of(bag), film_of(bag)
    order = [*range(60), *range(59, -1, -7)]
    with ThreadPoolExecutor(6) as threads:
        together = list(threads.map(film.jpeg, order))
    assert together == [alone.jpeg(i) for i in order]


def test_frames_without_a_known_lateral_camera_are_no_film(tmp_path):
    for name, cameras in (("dorsal", {"dorsal": CAMERAS["dorsal"]}), ("none", None), ("empty", b"")):
        bag = filmed(tmp_path / name, cameras=cameras)
        assert film_of(Bag.open(bag)) is None
        assert film_strip.of_bag(bag) == []
    assert film_of(Bag.open(filmed(tmp_path / "both"))) is not None


@pytest.mark.parametrize("text", [b"dorsal: 2020-13-01\n", b"lateral: {", b"lateral: \xff\n", b"5"])
def test_cameras_that_can_not_be_read_are_refused_by_name(tmp_path, text):
    with pytest.raises(InputError, match=r"b: (attachment )?cameras\.yaml: "):
        film_of(Bag.open(filmed(tmp_path / "b", cameras=text)))


def test_the_strip_of_a_campaign_is_that_of_its_first_bag_with_a_film(tmp_path):
    filmed(tmp_path / "trials" / "a", cameras=None)
    bag = filmed(tmp_path / "trials" / "b")
    filmed(tmp_path / "trials" / "c")
    assert film_strip.film_strip(tmp_path) == film_strip.of_bag(bag)
    assert [name.split("(")[1] for _, name in film_strip.of_bag(bag)] == 4 * ["b, lateral camera)"]
