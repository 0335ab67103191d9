"""Two people at two consoles, or at two pages of one: what one of them stops, or started, whatever the other does."""

import json
import sys
import threading
import urllib.request
from concurrent.futures import ThreadPoolExecutor

import pytest

from sandbot_common import topics
from sandbot_common.ros import endpoints
from sandbot_common.standstill import STOPPED_S

pytestmark = [pytest.mark.ros, pytest.mark.timeout(300)]


class Page:
    """A page open in a browser, as its console sees it: it requests the state five times a second until closed."""

    def __init__(self, url, name):
        self.url, self.name, self.at_s, self.closed = url, name, 0.0, threading.Event()
        self.ask("state")
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self):
        while not self.closed.wait(0.2):
            self.ask("state")

    def ask(self, path, data=None):
        headers = {"X-Trackway": str(self.at_s), "X-Trackway-Page": self.name}
        request = urllib.request.Request(f"{self.url}{path}", data=data, headers=headers)
        with urllib.request.urlopen(request, timeout=30) as answer:
            said = json.load(answer)
        self.at_s = said.get("at_s", self.at_s)
        return said

    def press(self, path):
        return self.ask(path, b"")


@pytest.fixture
def trackway(start, beside):
    """A clock and two consoles that have heard of it; the last set-point, and pages that are closed in the end."""
    moving, pages = [False], []
    start(
        sys.executable, "-m", "sandbot_clock.nodes.clock_node", "--ros-args", "-p", "late_s:=0.25", "-p", "lease_s:=1.0"
    )
    endpoints.subscription(beside.node, topics.LEG_SETPOINTS, lambda message: moving.append(any(message.velocity)))
    consoles = [
        start(sys.executable, "-m", "sandbot_bringup.nodes.console_node", "--ros-args", "-p", "port:=0") for _ in "12"
    ]
    urls = [(line := one.until(lambda text: "http://" in text))[line.index("http://") :].rstrip() for one in consoles]

    def opened(console, name):
        pages.append(Page(urls[console], name))
        beside.until(lambda: "clock" in pages[-1].ask("state")["nodes"])
        return pages[-1]

    yield lambda: moving[-1], opened
    for page in pages:
        page.closed.set()


def test_a_stop_outlives_the_start_of_another_console_that_was_under_way(trackway, beside):
    moving, opened = trackway
    first, second = opened(0, "a"), opened(1, "b")
    with ThreadPoolExecutor() as people:
        for delay_s in (0.012, 0.03, 0.2):
            beside.wait(lambda: False, STOPPED_S + 0.2)  # what the last stop, or the clock's begin, refuses is over
            begun = people.submit(first.press, "call/start")
            beside.wait(lambda: False, delay_s)
            stopped = people.submit(second.press, "stop")
            beside.until(lambda both=(begun, stopped): all(one.done() for one in both))
            beside.wait(lambda: not moving(), 5.0)
            assert not beside.wait(moving, 1.0), (delay_s, begun.result(), stopped.result())
    beside.until(lambda: first.press("call/start")["success"])
    beside.until(moving)


def test_legs_end_with_the_page_that_started_them_whoever_else_looks_on(trackway, beside):
    moving, opened = trackway
    first, other = opened(0, "a"), opened(0, "b")
    beside.until(lambda: first.press("call/start")["success"])
    beside.until(moving)
    other.closed.set()
    assert not beside.wait(lambda: not moving(), 4.0)  # spectators come and go
    opened(0, "c")
    first.closed.set()
    beside.until(lambda: not moving(), 10.0)
