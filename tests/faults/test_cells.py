"""The file of the matrix of faults."""

import cells
import pytest

WALKING = ("clock", "KILL", "walking")


def row(cell=WALKING, status="the clock is gone", legs="0.02"):
    return [*cell, legs, "-", "whole", status, "exit 1", "nothing", "3"]


def spoilt(cell=WALKING):
    return [*cell, "-", "-", "-", "-", f"{cells.NEVER_CAME}: the tracker is stuck", "-", "-"]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "cells.jsonl"


def test_what_was_run_is_not_run_again(path):
    other = ("bed", "KILL", "blowing")
    cells.add(path, row())
    assert cells.missing([WALKING, other], path) == [other]


def test_without_a_file_all_is_missing(path):
    assert cells.missing([WALKING], path) == [WALKING]


def test_a_trial_that_ended_before_the_fault_is_run_again_and_never_hides_a_row(path):
    cells.add(path, spoilt())
    assert cells.missing([WALKING], path) == [WALKING]
    cells.add(path, row())
    cells.add(path, spoilt())
    assert cells.missing([WALKING], path) == []
    assert cells.read(path)[WALKING]["legs [s]"] == "0.02"


def test_legs_that_had_come_to_rest_before_the_fault_say_nothing(path):
    cells.add(path, row(legs=cells.NONE))
    assert cells.missing([WALKING], path) == [WALKING]


def test_of_two_rows_the_last_counts(path):
    cells.add(path, row(legs="0.70"))
    cells.add(path, row(legs="0.10"))
    (kept,) = cells.read(path).values()
    assert kept["legs [s]"] == "0.10"


def test_the_slowest_moment_of_a_fault_stands_for_all(path):
    for legs, moment in (("0.02", "walking"), ("NEVER", "stopping"), ("-", "closing")):
        cells.add(path, row(("clock", "KILL", moment), legs=legs))
    cells.add(path, spoilt(("clock", "KILL", "blowing")))
    (only,) = cells.worst(cells.read(path).values()).splitlines()[2:]
    assert only == "| clock | KILL | 3 | NEVER | - | 3 | nothing | 3 to 3 |"


def test_the_campaign_s_words_stand_where_they_say_more_than_the_bag(path):
    one = row()
    one[7] = "exit 1: phi0.6_r01: failed: the clock is gone"
    two = row(("bed", "TERM", "standing"), status="the bed node stopped")
    two[7] = "exit 2: start it again"
    cells.add(path, one)
    cells.add(path, two)
    campaign = [text.split(" | ")[7] for text in cells.table(cells.read(path).values()).splitlines()[2:]]
    assert campaign == ["1", "2: start it again"]
