"""Trials run by a single worker thread: what failed of itself, and what for want of a worker or of room."""

import errno
import os
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from sandbot_bringup import runner
from sandbot_bringup.plan import Plan, trials_of

TRIALS = trials_of(Plan(name="six", phi=(0.6,), omega_rad_s=(8.0, 16.0), replicates=3))
CREW = SimpleNamespace(size=1, lost="a worker was killed", executor=lambda: ThreadPoolExecutor(1))


def outcome(error):
    """Of six trials, the second of which ends in an error."""

    def job(trial, _):
        if trial is TRIALS[1] and error is not None:
            raise error

    return runner.run(TRIALS, job, CREW)


@pytest.mark.parametrize(
    ("error", "failed", "cut_short"),
    [(None, 0, False), (ValueError("no markers"), 1, False), (OSError(5, "Input/output error"), 1, True)],
)
def test_a_bad_disk_cuts_a_campaign_short_and_a_bad_trial_does_not(error, failed, cut_short):
    found = outcome(error)
    assert (len(found.failed), len(found.finished), found.cut_short) == (failed, 6 - failed, cut_short)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_on_a_disk_that_takes_nothing_no_further_trial_is_computed(number):
    found = outcome(OSError(number, os.strerror(number)))
    assert found.cut_short
    assert {reason for _, reason in found.failed} == {f"can't be written: {os.strerror(number)}; resume to run it"}
    # What was under way with it has been finished.
    assert 3 <= len(found.failed) <= 5
    assert sorted([*found.finished, *dict(found.failed)]) == sorted(trial.trial_id for trial in TRIALS)


def test_a_lost_worker_is_no_failure_of_its_trial():
    found = outcome(BrokenExecutor("terminated abruptly"))
    assert found.cut_short
    assert {reason for _, reason in found.failed} == {"a worker was killed; resume to run it"}
    assert len(found.finished) + len(found.failed) == 6
