"""How far the wall clock is ahead: what a set clock changes, and what only a busy machine."""

import pytest

from sandbot_common import host_clock
from sandbot_common.errors import InputError
from sandbot_common.host_clock import HostClock, check_set

AHEAD_NS, SECOND_NS = 1_700_000_000_000_000_000, 1_000_000_000


@pytest.fixture
def host(monkeypatch):
    """A host whose clocks are read here: ``ahead_ns`` sets one, ``held_ns`` is how long each reading takes."""

    class Host:
        now_ns, ahead_ns, held_ns = 0, AHEAD_NS, 100

        def monotonic_ns(self):
            self.now_ns += self.held_ns
            return self.now_ns

        def time_ns(self):
            return self.monotonic_ns() + self.ahead_ns

    one = Host()
    monkeypatch.setattr(host_clock, "time", one)
    return one


@pytest.mark.parametrize("step_s", [15, 3600, -6, 0.02])
def test_a_clock_that_is_set_is_followed_at_once_and_told_once(host, step_s):
    clock = HostClock()
    assert (clock.look(), clock.ahead_ns()) == (0, AHEAD_NS)
    host.ahead_ns += round(step_s * SECOND_NS)
    assert clock.look() == round(step_s * SECOND_NS)
    assert (clock.look(), clock.ahead_ns()) == (0, host.ahead_ns)


def test_a_process_that_is_held_up_while_it_reads_has_seen_no_clock_set(host):
    clock = HostClock()
    for host.held_ns in (50_000_000, 100, 2_000_000_000):
        assert abs(clock.ahead_ns() - AHEAD_NS) <= 50_000_000
        assert clock.look() == 0
    assert clock.ahead_ns() == AHEAD_NS  # the narrowest look counts


def test_the_first_reading_is_corrected_by_a_better_one(host):
    host.held_ns = SECOND_NS
    clock = HostClock()
    host.held_ns = 100
    assert (clock.look(), clock.ahead_ns()) == (0, AHEAD_NS)


def test_a_clock_that_nobody_has_set_yet_is_named():
    with pytest.raises(InputError, match=r"the host's clock shows 1970-01-01, so it has not been set yet"):
        check_set(62.0)
    check_set(AHEAD_NS * 1e-9)
