"""No more is sent than readers take; who takes nothing for a second is not waited for."""

import pytest

from sandbot_common.ros import window_node
from sandbot_common.ros.window_node import PATIENCE_S, Window


class Reader:
    """A publisher whose readers take all, or nothing."""

    takes = True

    def wait_for_all_acked(self, timeout):
        assert timeout.nanoseconds == 0  # a node's loop is not held up
        return self.takes


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(window_node.time, "monotonic", lambda: now[0])
    return now


def send(window, most=10):
    """How many go out until the window shuts."""
    for count in range(most):
        if not window.open:
            return count
        window.sent()
    return most


def test_who_reads_gets_all(clock):
    assert send(Window([Reader(), Reader()], 3), most=50) == 50


def test_one_that_reads_nothing_holds_the_rest_until_he_does(clock):
    quick, slow = Reader(), Reader()
    window = Window([quick, slow], 3)
    slow.takes = False
    assert send(window) == 3
    clock[0] += 0.9 * PATIENCE_S
    assert send(window) == 0
    slow.takes = True
    assert send(window) == 10


def test_one_that_has_died_is_waited_for_once(clock):
    dead = Reader()
    dead.takes = False
    window = Window([dead], 3)
    assert send(window) == 3
    clock[0] += 1.1 * PATIENCE_S
    assert send(window, most=50) == 50
    # As soon as all is taken, the next standstill is waited for again.
    dead.takes = True
    assert window.open
    dead.takes = False
    assert send(window) == 3
