import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.safety import ALIVE_S, FRESH_S, Safety

NAN = float("nan")
REST, TURN = [0.0] * 6, [0.0, 3.0]


def told(blower=None, rates=None, running=None, t_s=10.0):
    safety = Safety()
    if running is not None:
        safety.on_clock(running, t_s)
    if blower is not None:
        safety.on_air(blower, t_s)
    if rates is not None:
        safety.on_legs(rates, t_s)
    return safety


@pytest.mark.parametrize(
    ("blower", "rates", "state"),
    [
        (None, None, "unknown"),
        (0.0, None, "unknown"),
        (None, REST, "unknown"),
        (0.0, REST, "free"),
        (0.0, TURN, "legs"),
        (0.4, REST, "air"),
        (NAN, REST, "air"),
        (0.4, TURN, "broken"),
        (0.4, [NAN], "broken"),
    ],
)
def test_what_is_fresh_is_said_as_it_is(blower, rates, state):
    assert told(blower, rates).statement(10.1).state == state


def walk_then_prepare(keep):
    """A walk, its end, and the next preparation as the topics bring them; only the leg states that ``keep`` says."""
    safety, states = Safety(), []
    for step in range(1, 3000):
        t_s = 0.005 * step
        walking, blowing = t_s < 5.0, t_s > 7.0
        if t_s <= 5.0 and keep(step):
            safety.on_legs(TURN if walking else REST, t_s)
        if step % 2 == 0:
            safety.on_air(1.0 if blowing else 0.0, t_s)
        if step % 40 == 0:
            safety.on_clock(walking, t_s)
        states.append(safety.statement(t_s).state)
    return safety, states


def test_a_preparation_after_a_walk_is_no_alarm():
    """Issue 12, row 13: five samples a second, first come first served, never showed the one word of rest."""
    safety, states = walk_then_prepare(lambda _: True)
    assert safety.overlap is None
    assert states[-1] == "air"
    assert "broken" not in states
    assert "unknown" not in states[40:]  # by then the clock has been heard


def test_a_word_of_rest_that_was_lost_is_unknown_and_no_alarm_either():
    _, states = walk_then_prepare(lambda step: step < 1000)
    assert "broken" not in states
    assert states[-1] == "unknown"


def test_a_real_overlap_is_red_however_short_and_stays_until_it_is_acknowledged():
    safety = told(0.0, TURN, True)
    safety.on_air(1.0, 10.05)
    assert safety.statement(10.05).state == "broken"
    safety.on_legs(REST, 10.06)
    safety.on_air(0.0, 10.07)
    said = safety.statement(15.0 - 1e-6)
    assert said.state == "overlapped"
    assert "for 0.00 s, 5 s ago" in said.text
    safety.on_clock(False, 15.0)
    safety.on_air(0.0, 15.0)
    safety.acknowledge()
    assert safety.statement(15.0).state == "free"


def test_an_overlap_that_goes_on_is_one():
    safety = told(1.0, TURN)
    for step in range(1, 50):
        safety.on_air(1.0, 10.0 + 0.01 * step)
        safety.on_legs(TURN, 10.0 + 0.01 * step)
    assert safety.overlap.since_s == 10.0
    assert safety.overlap.until_s == pytest.approx(10.49)


def test_silence_is_normal_at_rest_and_unknown_in_motion():
    still = told(0.0, REST, False)
    still.on_clock(False, 100.0)
    assert (still.legs(100.0).state, still.legs(100.0).text) == ("still", "legs still")
    for running, t_s, why in ((True, 100.0, "the clock is running"), (False, 100.0 - 2 * ALIVE_S, "clock is silent")):
        still.on_clock(running, t_s)
        assert still.legs(100.0).state == "unknown"
        assert why in still.legs(100.0).text
    moving = told(0.0, TURN, False)
    moving.on_clock(False, 100.0)
    assert moving.legs(100.0).text == "legs moved when last heard, 90 s ago"
    assert moving.legs(100.0).state == "unknown"


def test_a_robot_that_said_nothing_yet_is_still_only_while_a_clock_says_it_commands_nothing():
    assert told(0.0, None, False).legs(10.1).state == "still"
    assert told(0.0, None, True).legs(10.1).state == "unknown"


def test_a_silent_blower_is_unknown_whatever_it_said():
    for level in (0.0, 1.0):
        said = told(level, REST, False).air(10.0 + 2 * FRESH_S)
        assert said.state == "unknown"
        assert f"{level:.2f}" in said.text


def test_when_all_came_to_rest_is_known():
    safety = told(1.0, TURN, True)
    assert not safety.at_rest(10.0)
    safety.on_legs(REST, 10.2)
    safety.on_legs(REST, 10.3)
    assert not safety.at_rest(10.3)  # air is on
    safety.on_air(0.0, 10.4)
    safety.on_air(0.0, 10.5)
    assert (safety.rest_s, safety.off_s) == (10.2, 10.4)
    assert safety.at_rest(10.5)
    safety.on_air(1.0, 10.6)
    safety.on_legs(TURN, 10.6)
    assert (safety.rest_s, safety.off_s) == (10.2, 10.4)
    safety.on_air(0.0, 10.7)
    assert not safety.at_rest(10.7)  # legs turn


EVENTS = st.tuples(st.sampled_from(["legs", "air", "clock"]), st.booleans(), st.floats(0.0, 2.0))


@given(st.lists(EVENTS))
def test_it_is_broken_only_where_both_last_words_are_fresh_and_bad(events):
    safety, now_s, last = Safety(), 0.0, {}
    for what, on, after_s in events:
        now_s += after_s
        last[what] = on, now_s
        if what == "legs":
            safety.on_legs(TURN if on else REST, now_s)
        elif what == "air":
            safety.on_air(float(on), now_s)
        else:
            safety.on_clock(on, now_s)
    bad = all(last.get(one, (False, 0))[0] and now_s - last[one][1] <= FRESH_S for one in ("legs", "air"))
    assert (safety.statement(now_s).state == "broken") == bad
    assert safety.overlap is not None or not bad
