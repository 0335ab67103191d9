from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.hold import Hold


def test_a_stop_ends_the_trial_at_once_and_holds_until_go():
    hold = Hold()
    assert hold.state == "running"
    assert hold.go() == (True, "the campaign was running")
    hold.pause()
    hold.stop("a hand")
    assert (hold.now, hold.state) == (True, "stopping")
    assert hold.go() == (False, "the trial under way is still being stopped")
    hold.between_trials()
    assert (hold.now, hold.state, hold.why) == (False, "held", "a hand")
    assert hold.go() == (True, "the campaign goes on")
    hold.between_trials()
    assert hold.state == "running"  # a pause asked for before the stop is no longer pending


def test_a_pause_lets_the_trial_end_and_go_takes_it_back():
    hold = Hold()
    hold.pause()
    assert (hold.now, hold.state) == (False, "pausing")
    assert hold.go()[0]
    hold.between_trials()
    assert hold.state == "running"
    hold.pause()
    hold.between_trials()
    assert (hold.state, hold.why) == ("held", "paused by the operator")


def test_a_stop_that_is_said_again_while_it_is_held_leaves_it_held():
    """STOP is said until it is answered; a late one found nothing to end, and then go was refused for ever."""
    hold = Hold()
    hold.stop("a hand")
    hold.between_trials()
    hold.stop("a hand")
    assert (hold.now, hold.state) == (False, "held")
    assert hold.go()[0]


def test_a_pause_does_not_soften_a_stop():
    hold = Hold()
    hold.stop("a hand")
    assert "held already" in hold.pause()
    assert hold.now


@given(st.lists(st.sampled_from(["stop", "pause", "between", "go"])))
def test_after_a_stop_nothing_runs_before_a_go_and_all_runs_after_it(words):
    hold, stopped = Hold(), False
    for word in words:
        match word:
            case "stop":
                hold.stop("a hand")
                stopped = True
            case "pause":
                hold.pause()
            case "between":
                hold.between_trials()
            case "go":
                stopped = stopped and not hold.go()[0]
        assert bool(hold.why) or not stopped
    # And between trials it never refuses to go on.
    hold.between_trials()
    assert hold.go()[0]
    assert hold.state == "running"
