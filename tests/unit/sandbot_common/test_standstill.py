from sandbot_common.standstill import AWAKE_S, LIMIT_S, Standstill

THAWED_S = 100.0 + LIMIT_S + 1.0


def turning():
    """A loop that has turned from 99 to 100 s."""
    loop = Standstill()
    for tenth in range(990, 1001):
        loop.turn(tenth / 10)
    return loop


def test_a_loop_that_turns_obeys():
    assert Standstill().refusal(5.0) == ""
    assert turning().refusal(100.1) == ""
    assert turning().refusal(100.0 + LIMIT_S) == ""


def test_what_comes_first_after_a_standstill_is_not_obeyed_whether_the_timer_came_before_it_or_not():
    assert "old request" in turning().refusal(THAWED_S)
    loop = turning()
    loop.turn(THAWED_S)
    loop.turn(THAWED_S + 0.1)
    assert "old request" in loop.refusal(THAWED_S + 0.1)


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
