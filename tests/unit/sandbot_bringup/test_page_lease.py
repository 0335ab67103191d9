"""The lease of what is started from the page, without a graph."""

import threading
import time
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import pytest

from sandbot_bringup.console import Console
from sandbot_bringup.nodes import console_node, page_lease_node
from sandbot_bringup.nodes.console_node import ACTIONS, STOP, ConsoleNode
from sandbot_bringup.nodes.page_lease_node import PRESENT_S, PageLease


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


def started(graph, *pages):
    """Each page has started something, or said that it is to run, and clock and bed have had time to tell."""
    for page in pages:
        with graph.lease.taken():
            graph.lease.hold(page)
    graph.lease._until_s = 0.0


def later(graph, *seen):
    """As the loop turns, more than 2 s later, all pages but ``seen`` have been closed."""
    graph.lease._holders = {page: at_s - PRESENT_S for page, at_s in graph.lease._holders.items()}
    for page in seen:
        graph.lease.seen(page)
    graph.turn()


def test_what_a_page_starts_is_leased_until_it_is_over(graph):
    graph.turn()
    assert not graph.offered  # a person at a terminal, or a campaign, may command
    with graph.lease.taken():
        assert graph.renewals == 1  # heard of before clock or bed are asked
        graph.lease.hold("a")
    graph.lease._until_s = 0.0  # they have had time to tell
    graph.turn()
    assert graph.renewals == 2
    graph.goes_on = False
    graph.turn()
    assert (graph.renewals, graph.offered) == (2, False)
    graph.goes_on = True  # by another's hand
    graph.turn()
    assert not graph.offered


def test_it_ends_with_the_page_that_started_it_whoever_else_looks_on(graph):
    started(graph, "a")
    later(graph, "a", "b")
    assert graph.offered
    later(graph, "b")
    assert not graph.offered
    later(graph, "a", "b")  # a laptop that was closed for a moment starts nothing again
    assert not graph.offered
    started(graph, "b")
    later(graph, "b")
    assert graph.offered


def test_it_ends_with_the_first_of_two_pages_that_wanted_it(graph):
    started(graph, "a", "b")
    later(graph, "a", "b")
    assert graph.offered
    later(graph, "b")
    assert not graph.offered


def test_who_is_refused_keeps_nothing_going_and_ends_nothing(graph):
    started(graph, "a")
    with graph.lease.taken():
        pass  # b was refused
    graph.lease._until_s = 0.0
    later(graph, "a")
    assert graph.offered
    with graph.lease.taken():
        later(graph)  # not even while it asks
        assert not graph.offered


def test_requests_without_a_name_are_no_page(graph):
    started(graph, "")
    later(graph, "")
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
    ("node", "said", "goes_on"),
    [
        ("clock", {"running": "True"}, True),
        ("clock", {"running": "False"}, False),
        ("bed", {"stage": "pulse"}, True),
        ("bed", {"stage": "ready"}, False),
    ],
)
def test_it_goes_on_while_clock_or_bed_are_at_it(node, said, goes_on):
    one = object.__new__(ConsoleNode)
    one._lock, one._state = threading.Lock(), Console({})
    one._state.set_node(node, 0, "ok", said, time.monotonic())
    assert one._under_way() is goes_on


def test_only_what_moves_or_blows_is_called_under_it_and_held_by_the_page_that_asked():
    one, held, refused = object.__new__(ConsoleNode), [], "/bed/prepare"
    one._lease = SimpleNamespace(taken=lambda: held.append("taken") or nullcontext(), hold=held.append)
    one._lock, one._stops = threading.Lock(), 0
    one._call = lambda action, service, _: (held.append(service) or service != refused, "")
    for action in ("start", "halt", "prepare"):
        one.call(action, "a")
    assert held == ["taken", "/clock/start", "a", "/clock/stop", "taken", "/bed/prepare"]


@pytest.mark.parametrize(
    "pressed", [ConsoleNode.stop, lambda one: one.call("halt", "b"), lambda one: one.call("abort", "b")]
)
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
    one._lock, one._stops, one._state = threading.Lock(), 0, Console({})
    one._lease = SimpleNamespace(taken=taken, hold=lambda _: None)
    assert one.call("start", "a") == (False, "stopped meanwhile")
    assert "/clock/start" not in called
    one._lease.taken = nullcontext
    one.call("start", "a")
    assert "/clock/start" in called
