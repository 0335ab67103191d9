"""The lease of what is started from the page, without a graph."""

import threading
import time
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import pytest

from sandbot_bringup.console import Console
from sandbot_bringup.nodes import console_node, page_lease_node
from sandbot_bringup.nodes.console_node import ACTIONS, STOP, ConsoleNode
from sandbot_bringup.nodes.page_lease_node import PageLease


class Graph:
    """A node, and the publisher of its lease; ``turn`` turns its loop once."""

    def __init__(self):
        self.commanders, self.renewals, self.offered, self.goes_on = 0, 0, False, True
        self.now = SimpleNamespace(nanoseconds=1)

    def offer(self, *_):
        self.offered = True
        return self

    def publish(self, _):
        self.renewals += 1

    def wait_for_all_acked(self, _):
        return True

    def destroy_publisher(self, _):
        self.offered = False

    def count_publishers(self, _):
        return self.commanders

    def get_clock(self):
        return SimpleNamespace(now=lambda: self.now)

    def get_name(self):
        return "console"


@pytest.fixture
def graph(monkeypatch):
    one = Graph()
    monkeypatch.setattr(page_lease_node.endpoints, "publisher", one.offer)
    monkeypatch.setattr(page_lease_node, "Timer", lambda _ros, _period, turn: setattr(one, "turn", turn))
    monkeypatch.setattr(page_lease_node, "real_time_while", lambda *_: None)
    # What waits is turned to: the loop is another thread's.
    monkeypatch.setattr(page_lease_node.time, "sleep", lambda _: one.turn())
    one.lease = PageLease(one, lambda: one.goes_on)
    return one


def test_what_the_page_starts_is_leased_until_it_is_over_or_nobody_looks_on(graph):
    graph.turn()
    assert not graph.offered  # a person at a terminal, or a campaign, may command
    with graph.lease.taken():
        assert graph.renewals == 1  # heard of before clock or bed are asked
    graph.lease._until_s = 0.0  # they have had time to tell
    graph.turn()
    assert graph.renewals == 2
    graph.goes_on = False
    graph.turn()
    assert (graph.renewals, graph.offered) == (2, False)
    graph.goes_on = True  # by another's hand
    graph.turn()
    assert not graph.offered


def test_two_pages_ask_at_once(graph, monkeypatch):
    """The first answer, and the time to settle after it, do not end the lease of the other."""
    monkeypatch.setattr(page_lease_node, "SETTLE_S", 0.0)
    graph.goes_on = False
    with graph.lease.taken():
        with graph.lease.taken():
            pass
        graph.turn()
        assert graph.offered
    graph.turn()
    assert not graph.offered


def test_a_campaign_that_commands_is_not_made_one_of_two(graph):
    graph.commanders = 1
    with graph.lease.taken():
        graph.turn()
        assert not graph.offered


@pytest.mark.parametrize(
    ("node", "said", "page_s", "goes_on"),
    [
        ("clock", {"running": "True"}, 0.5, True),
        ("clock", {"running": "False"}, 0.5, False),
        ("clock", {"running": "True"}, 5.0, False),
        ("bed", {"stage": "pulse"}, 0.5, True),
        ("bed", {"stage": "ready"}, 0.5, False),
    ],
)
def test_it_goes_on_while_a_page_looks_on_and_clock_or_bed_are_at_it(node, said, page_s, goes_on):
    one = object.__new__(ConsoleNode)
    one._lock, one._state, one._watched_s = threading.Lock(), Console({}), time.monotonic() - page_s
    one._state.set_node(node, 0, "ok", said, time.monotonic())
    assert one._lease_needed() is goes_on


def test_only_what_moves_or_blows_is_called_under_it():
    one, held = object.__new__(ConsoleNode), []
    one._lease = SimpleNamespace(taken=lambda: held.append("taken") or nullcontext())
    one._lock, one._stops = threading.Lock(), 0
    one._call = lambda action, service, _: held.append(service)
    for action in ("start", "halt", "prepare"):
        one.call(action)
    assert held == ["taken", "/clock/start", "/clock/stop", "taken", "/bed/prepare"]


@pytest.mark.parametrize("pressed", [ConsoleNode.stop, lambda one: one.call("halt"), lambda one: one.call("abort")])
def test_what_was_stopped_while_it_waited_for_its_lease_is_not_started(pressed, monkeypatch):
    monkeypatch.setattr(console_node, "STOP_S", 0.0)  # its answers are not waited for
    one, called = object.__new__(ConsoleNode), []

    @contextmanager
    def taken():
        pressed(one)
        yield

    def trigger(name):
        future = SimpleNamespace(
            add_done_callback=lambda done: done(None), result=lambda: SimpleNamespace(success=True, message="")
        )
        return SimpleNamespace(service_is_ready=lambda: True, call_async=lambda _: called.append(name) or future)

    one._triggers = {name: trigger(name) for name in {*ACTIONS.values(), *STOP.values()}}
    one._lock, one._stops, one._state, one._lease = threading.Lock(), 0, Console({}), SimpleNamespace(taken=taken)
    assert one.call("start") == (False, "stopped meanwhile")
    assert "/clock/start" not in called
    one._lease.taken = nullcontext
    one.call("start")
    assert "/clock/start" in called
