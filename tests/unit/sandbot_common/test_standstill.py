import pytest

from sandbot_common.standstill import AWAKE_S, BEGUN, BEGUN_S, LIMIT_S, OLD, REFUSED_S, STOPPED, STOPPED_S, Standstill

THAWED_S = 100.0 + LIMIT_S + 1.0


def turning():
    """A loop that has turned from 90 to 100 s."""
    loop = Standstill()
    for tenth in range(900, 1001):
        loop.turn(tenth / 10)
    return loop


def test_a_loop_that_turns_obeys():
    assert turning().refusal(100.1) == ""
    assert turning().refusal(100.0 + LIMIT_S) == ""


def test_what_comes_first_after_a_standstill_is_not_obeyed_whether_the_timer_came_before_it_or_not():
    assert "old request" in turning().refusal(THAWED_S)
    loop = turning()
    loop.turn(THAWED_S)
    loop.turn(THAWED_S + 0.1)
    assert "old request" in loop.refusal(THAWED_S + 0.1)


@pytest.mark.parametrize("first", [Standstill.turn, Standstill.refusal])
def test_what_was_meant_for_the_process_before_it_starts_nothing(first):
    """A clock that was stopped, and started anew, met a start that had waited for it."""
    loop = Standstill()
    first(loop, 100.0)
    assert loop.refusal(100.1) == BEGUN
    assert loop.refusal(100.1 + BEGUN_S) == ""


def test_a_stop_outlives_what_was_asked_before_it_and_no_longer():
    loop = turning()
    loop.stop(100.5)
    loop.stop(101.0)
    for second in range(101, 104):
        assert loop.refusal(second) == STOPPED
    assert loop.refusal(101.1 + STOPPED_S) == ""


def test_a_stop_shortens_no_other_refusal():
    """What was sent to a loop that stood still may arrive later than a stop would count."""
    loop = turning()
    assert loop.refusal(THAWED_S) == OLD
    loop.stop(THAWED_S + 0.1)
    for second in range(1, 6):
        assert loop.refusal(THAWED_S + second)
    assert loop.refusal(THAWED_S + AWAKE_S + 0.1) == ""
    assert REFUSED_S[BEGUN] < REFUSED_S[STOPPED] < REFUSED_S[OLD]


def test_a_stop_is_told_for_as_long_as_it_counts_and_no_longer():
    """The longer refusal of a loop that stood still is no stop: a campaign would take it for one by hand."""
    loop = turning()
    loop.turn(THAWED_S)
    loop.stop(THAWED_S)
    loop.turn(THAWED_S + 0.1)
    said = [loop.refusal(THAWED_S + second) for second in (0.1, STOPPED_S, STOPPED_S + 0.1, AWAKE_S)]
    assert said == [STOPPED, STOPPED, OLD, OLD]


def test_who_asks_again_is_obeyed():
    loop = turning()
    assert loop.refusal(THAWED_S)
    for second in range(1, 6):
        loop.turn(THAWED_S + second)
    assert loop.refusal(THAWED_S + AWAKE_S + 0.1) == ""


def test_it_says_how_long_it_stood_still():
    loop = turning()
    assert not loop.turn(100.1)
    assert loop.held_s == 0.0
    assert loop.turn(141.1)
    assert (loop.held_s, loop.woke_s) == (41.0, 141.1)
    assert not loop.turn(141.2)
