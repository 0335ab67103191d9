"""The campaign knows that its bed has failed, though it slept when that was said; and takes no older failure for it."""

import pytest

from sandbot_bringup.preparation import Preparation

BEFORE = ("3", "failed")
"""What a bed says of the preparation before, and goes on to say until it is asked for another."""


@pytest.mark.parametrize("stage", ["ready", "failed", "idle"])
@pytest.mark.parametrize(
    "heard",
    [
        [("4", "fluidise")],
        [("4", "pulse"), ("4", "settle")],
        [],  # frozen for so long that only the end of it is left
        [("3", "fluidise")],  # somebody else had asked for it: it is joined
    ],
)
def test_what_was_asked_is_over_when_it_has_ended(heard, stage):
    asked = Preparation("3")
    number = heard[-1][0] if heard else "4"
    assert [asked.over(*one) for one in (BEFORE, *heard)] == [False] * (1 + len(heard))
    assert asked.over(number, stage)


@pytest.mark.parametrize("before", ["3", ""])
def test_an_older_failure_is_none_of_this_one(before):
    asked = Preparation(before)
    assert not any(asked.over(*BEFORE) for _ in range(3))


def test_a_bed_that_tells_no_number_is_seen_busy():
    asked = Preparation("")
    assert not asked.over("", "failed")
    assert not asked.over("", "ramp_down")
    assert asked.over("", "failed")


def test_a_bed_that_was_ready_before_or_rests_between_pulses_has_not_ended_its_preparation():
    asked = Preparation("3")
    assert not any(asked.over(*one) for one in (("3", "ready"), ("4", "fluidise"), ("4", "pulse"), ("4", "settle")))
