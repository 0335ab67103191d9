import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_clock.schedule import NANO, Schedule, keep, missed_warning


class Time:
    """A clock that sleeps exactly, and now and then loses time."""

    def __init__(self, start_ns, losses=()):
        self.now_ns, self.losses = start_ns, dict(losses)

    def sleep(self, seconds):
        self.now_ns += round(seconds * NANO)


def kept(time, rate_hz, count):
    """The instants kept, and those missed; ``time.losses`` maps a duty's number to the time it takes."""
    instants, missed = [], []

    def duty(instant_ns):
        instants.append(instant_ns)
        time.now_ns += time.losses.get(len(instants) - 1, 0)
        return len(instants) < count

    keep(Schedule(time.now_ns, rate_hz), duty, lambda: time.now_ns, time.sleep, missed.append)
    return instants, sum(missed)


@given(st.integers(0, 2**62), st.floats(20, 1000), st.integers(0, 10**9))
def test_instants_never_drift(start_ns, rate_hz, n):
    assert abs(Schedule(start_ns, rate_hz).instant(n) - start_ns - n * NANO / rate_hz) <= max(1, n * NANO / 2**52)


def test_on_time_every_instant_is_kept():
    instants, missed = kept(Time(1000), 200.0, 50)
    assert instants == [1000 + 5_000_000 * n for n in range(50)]
    assert missed == 0


def test_a_little_late_is_caught_at_the_next_instant():
    instants, missed = kept(Time(0, {3: 7_000_000}), 200.0, 8)
    assert instants == [5_000_000 * n for n in range(8)]
    assert missed == 0


def test_whole_periods_lost_are_skipped_and_counted():
    instants, missed = kept(Time(0, {3: 26_000_000}), 200.0, 6)
    # Instant 3 ended at 41 ms: 4 to 7 are gone, 8 (at 40 ms) is due.
    assert [instant // 5_000_000 for instant in instants] == [0, 1, 2, 3, 8, 9]
    assert missed == 4


@given(st.dictionaries(st.integers(0, 19), st.integers(0, 80_000_000)))
def test_kept_and_missed_add_up(losses):
    instants, missed = kept(Time(0, losses), 200.0, 20)
    assert instants[-1] // 5_000_000 + 1 == len(instants) + missed
    assert all(b > a for a, b in itertools.pairwise(instants))


@pytest.mark.parametrize("rate_hz", [150.0, 333.3, 1000.0])
def test_odd_rates(rate_hz):
    instants, missed = kept(Time(0), rate_hz, 100)
    assert missed == 0
    assert instants[-1] == pytest.approx(99 * NANO / rate_hz, abs=1)


@pytest.mark.parametrize(("missed", "kept", "said"), [(0, 0, ""), (0, 500, ""), (5, 495, ""), (6, 494, "6 of 500")])
def test_missed_deadlines_are_a_warning_above_one_in_a_hundred(missed, kept, said):
    assert missed_warning(missed, kept).startswith(said)
    assert bool(missed_warning(missed, kept)) == bool(said)
