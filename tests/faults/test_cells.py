"""The file of the matrix of faults."""

import cells
import pytest

WALKING = ("clock", "KILL", "walking")


def row(cell=WALKING, status="the clock is gone", legs="0.02"):
    return [*cell, legs, "-", "whole", status, "exit 1", "nothing", "3"]


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
    cells.add(path, row(status=f"{cells.NEVER_CAME}: the tracker is stuck", legs="-"))
    assert cells.missing([WALKING], path) == [WALKING]
    cells.add(path, row())
    cells.add(path, row(status=cells.NEVER_CAME))
    assert cells.missing([WALKING], path) == []
    assert cells.read(path)[WALKING]["legs [s]"] == "0.02"


def test_of_two_rows_the_last_counts(path):
    cells.add(path, row(legs="0.70"))
    cells.add(path, row(legs="0.10"))
    assert cells.table(cells.read(path).values()).splitlines()[2:] == [cells.line(row(legs="0.10"))]
