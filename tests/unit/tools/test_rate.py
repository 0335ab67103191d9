import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros2cli_fallback.rate import Rate

MS = 1_000_000


def feed(rate, times):
    printed = []
    for t_ns in times:
        rate.add(t_ns)
        if (figures := rate.due()) is not None:
            printed.append(figures)
    return printed


def test_a_steady_topic_prints_its_rate_once_a_second():
    printed = feed(Rate(10_000), range(5 * MS, 3010 * MS, 10 * MS))
    assert [one.window for one in printed] == [100, 200, 300]
    assert str(printed[0]) == "average rate: 100.000\n\tmin: 0.010s max: 0.010s std dev: 0.00000s window: 100"


def test_jitter_shows_in_extremes_and_deviation():
    times, t_ns = [], 0
    for index in range(200):
        t_ns += (8 if index % 2 else 12) * MS
        times.append(t_ns)
    (figures,) = feed(Rate(10_000), times)
    assert figures.rate_hz == pytest.approx(100.0, rel=0.01)
    assert (figures.min_s, figures.max_s) == (0.008, 0.012)
    assert figures.std_dev_s == pytest.approx(0.002, rel=0.01)


def test_the_window_forgets_what_is_older():
    slow_then_fast = [*range(0, 5000 * MS, 500 * MS), *range(5000 * MS, 8000 * MS, 10 * MS)]
    assert feed(Rate(50), slow_then_fast)[-1].rate_hz == pytest.approx(100.0)


def test_nothing_is_printed_without_messages_or_before_a_second():
    rate = Rate(10)
    assert rate.due() is None
    assert feed(rate, range(0, 1000 * MS, 10 * MS)) == []


def test_a_clock_that_steps_back_begins_anew():
    rate = Rate(10_000)
    feed(rate, range(10_000 * MS, 10_900 * MS, 10 * MS))
    printed = feed(rate, range(0, 1500 * MS, 20 * MS))
    assert [round(one.rate_hz) for one in printed] == [50]
    assert printed[0].min_s >= 0


@given(st.lists(st.integers(min_value=0, max_value=10**10), max_size=60))
def test_any_times_give_sane_figures(times):
    for figures in feed(Rate(7), times):
        assert figures.window <= 7
        assert 0 <= figures.min_s <= figures.max_s
        assert figures.rate_hz >= 0
