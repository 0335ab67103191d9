"""Drivers of other makers: best effort in colour, or compressed only, gives the speeds that reliable mono8 gives."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image

from sandbot_common import messages, topics
from sandbot_common.ros import endpoints, node
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.cameras import LabCamera

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300)]

CAMERAS = Path(__file__).parents[2] / "ros_ws/src/sandbot_bringup/config/cameras.yaml"
EMPTY, FRAMES, PERIOD_NS, SPEED = 40, 20, 10_000_000, 0.2
RAW = {"dorsal": topics.DORSAL_IMAGE.name, "lateral": topics.LATERAL_IMAGE.name}
NOISE = np.random.default_rng(2)
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def mono8(header, pixels):
    image = messages.image(0, "", pixels)
    image.header = header
    return image


def bgr8(header, pixels):
    height, width = pixels.shape
    image = Image(header=header, height=height, width=width, encoding="bgr8", step=3 * width)
    image.data.frombytes(np.repeat(pixels[..., None], 3, axis=-1).tobytes())
    return image


def png(header, pixels):
    image = CompressedImage(header=header, format="mono8; png compressed mono8")
    image.data.frombytes(cv2.imencode(".png", pixels)[1].tobytes())
    return image


DRIVERS = {
    "mono8": (mono8, Image, RELIABLE, ""),
    "bgr8, best effort": (bgr8, Image, qos_profile_sensor_data, ""),
    "compressed, best effort": (png, CompressedImage, qos_profile_sensor_data, "/compressed"),
}


def nothing():
    """An empty view with its noise: a frame that comes again and again, to the bit, is an old one."""
    return {name: NOISE.integers(55, 65, (480, 640), np.uint8) for name in RAW}


def films():
    """A robot that moves evenly, from both sides."""
    sections = read_yaml(CAMERAS)
    views = {name: LabCamera(name, sections[name], seed=3) for name in RAW}
    return [{name: view.render(0.3 + SPEED * n * 0.01, 0.025) for name, view in views.items()} for n in range(FRAMES)]


@pytest.fixture
def room_for_frames(monkeypatch):
    """Memory for frames, as camera nodes have it: in pieces over UDP a busy machine loses one of each."""
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(node.__file__).with_name("fastdds_frames.xml")))


def show(beside, driver, frames, said):
    """The speeds of a film, shown anew from its start where a busy machine has lost too much of it."""
    make, kind, qos, suffix = DRIVERS[driver]
    cameras = {name: beside.node.create_publisher(kind, topic + suffix, qos) for name, topic in RAW.items()}
    legs, led = (endpoints.publisher(beside.node, topic) for topic in (topics.LEG_STATES, topics.SYNC_LED))
    beside.until(lambda: all(one.get_subscription_count() for one in (*cameras.values(), legs, led)), 60.0)

    def send(stamp, views):
        legs.publish(messages.joint_state(stamp, topics.LEGS, *np.zeros((3, 6))))
        for name, pixels in views.items():
            cameras[name].publish(make(messages.header(stamp, name), pixels))

    shown = (film(beside, led, send, frames, said) for _ in range(20))
    speeds = next((one for one in shown if one is not None), None)
    for one in (*cameras.values(), legs, led):
        beside.node.destroy_publisher(one)
    return speeds


def film(beside, led, send, frames, said):
    """Send frame after frame, each when the one before has come back as a speed; None where one never did."""
    # Never ahead of the host's clock: frames may come late, but stamps from the future are a clock that was set.
    start_ns = beside.node.get_clock().now().nanoseconds
    led.publish(messages.header(start_ns, "sync_led"))
    # To a new reader it may come a second late, and a trial begins with it: only then the frames.
    assert led.wait_for_all_acked(Duration(seconds=60))

    def is_said(stamp, views):
        send(stamp, views)
        return beside.wait(lambda: stamp in said, 1.0)

    # Empty frames, after the LED, until the tracker has heard the legs and knows whose clock the stamps are.
    if not any(is_said(start_ns + n * PERIOD_NS, nothing()) for n in range(EMPTY)):
        return None
    stamps = [start_ns + n * PERIOD_NS for n in range(EMPTY, EMPTY + len(frames))]
    # Best effort may lose one.
    if not all(any(is_said(*each) for _ in range(5)) for each in zip(stamps, frames, strict=True)):
        return None
    return [said[stamp] for stamp in stamps]


def test_every_driver_gives_the_same_speeds(room_for_frames, start, beside):
    said = {}

    def hear(message):
        said[messages.nanoseconds(message.header.stamp)] = message.twist.twist.linear.x

    endpoints.subscription(beside.node, topics.SPEED, hear)
    tracker = start("ros2", "run", "sandbot_tracking", "tracker")
    frames = films()
    speeds = {driver: show(beside, driver, frames, said) for driver in DRIVERS}
    assert None not in speeds.values(), (speeds, tracker.lines)
    assert speeds["mono8"][-1] == pytest.approx(SPEED, rel=0.05)
    for driver, given in speeds.items():
        assert given == pytest.approx(speeds["mono8"], abs=2e-5, nan_ok=True), driver
