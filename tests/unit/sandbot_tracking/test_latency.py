from hypothesis import given
from hypothesis import strategies as st

from sandbot_tracking.latency import NOT_LIVE_S, TOO_OFTEN, Latency

BUDGET_S = 0.05


def fed(*delays_s):
    one = Latency(BUDGET_S)
    for delay_s in delays_s:
        one.add(delay_s)
    return one


def test_nothing_is_said_of_frames_in_time_and_a_warning_where_more_than_one_in_a_hundred_is_late():
    assert fed().warning == ""
    assert fed(*[0.01] * 99, 0.06).warning == ""
    assert fed(*[0.01] * 98, 0.06, 0.06).warning == "2 of 100 frames were later than 50 ms"
    assert fed(*[0.06] * 5).values() == {"latency_ms_median": "60.00", "latency_ms_p99": "60.00", "missed_deadlines": 5}
    assert fed().values()["latency_ms_p99"] == "nan"


def test_a_replay_tells_nothing_of_this_machine_and_a_trial_begins_anew():
    assert fed(NOT_LIVE_S + 1.0).frames == 0
    one = fed(0.06)
    one.restart()
    assert (one.missed, one.warning) == (0, "")


@given(st.lists(st.floats(0.0, 1.0), max_size=300))
def test_what_is_late_is_counted(delays_s):
    one, late = fed(*delays_s), sum(delay_s > BUDGET_S for delay_s in delays_s)
    assert one.missed == late
    assert bool(one.warning) == (late > TOO_OFTEN * len(delays_s))
