"""Two serial cameras of one name, each on a line of its own: the second shows nothing."""

import subprocess
import sys
import threading
from functools import partial

import cv2
import numpy as np
import pytest

from sandbot_common import topics
from sandbot_common.ros import endpoints
from sandbot_hardware import lines
from sandbot_hardware.pseudo_terminal import Terminal

RUN = "from sandbot_hardware.nodes.serial_camera_node import main; import sys; sys.exit(main())"


@pytest.fixture
def film(tmp_path, domain):
    """Start a serial camera of that name, whose line brings frames of that grey for as long as the test lasts."""
    started, over = [], threading.Event()

    def frames(grey):
        line, jpeg = Terminal(tmp_path / f"{grey}"), cv2.imencode(".jpg", np.full((16, 16), grey, np.uint8))[1]
        at_us = 0
        while not over.wait(0.02):
            at_us += 20_000
            line.say(partial(lines.encode_block, "C", at_us, jpeg.tobytes()))
        line.pull()

    def begin(name, grey):
        given = ["-r", f"__node:={name}", "-p", "camera:=dorsal", "-p", f"device:={tmp_path / str(grey)}"]
        thread = threading.Thread(target=frames, args=(grey,))
        thread.start()
        process = subprocess.Popen([sys.executable, "-c", RUN, "--ros-args", *given], stderr=subprocess.PIPE, text=True)
        started.append((process, thread))
        return process

    yield begin
    for process, _ in started:
        process.kill()
        process.wait()
        process.stderr.close()
    over.set()
    for _, thread in started:
        thread.join()


@pytest.mark.ros
@pytest.mark.parametrize("name", ["serial_dorsal", "serial_camera"])
def test_a_second_serial_camera_of_a_name_ends_before_it_shows_anything(film, beside, name):
    greys = set()
    endpoints.subscription(beside.node, topics.DORSAL_IMAGE, lambda image: greys.add(image.data[0]))
    first = film(name, 50)
    beside.until(lambda: greys)
    second = film(name, 200)
    if name == "serial_camera":  # the usual name: nodes of it may be those of both views
        beside.until(lambda: greys == {50, 200})
        return
    beside.until(lambda: second.poll() is not None)
    assert second.returncode == 2
    refusal = "another serial_dorsal is running already; one commander at a time, end it first\n"
    assert second.stderr.read().endswith(refusal)
    assert greys == {50}
    assert first.poll() is None
