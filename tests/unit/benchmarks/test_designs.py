"""Campaigns at random: the same number is the same campaign, all can be run, and a claim is judged by what acts."""

from types import SimpleNamespace

import numpy as np
import pytest

import designs


def test_a_number_is_a_campaign_and_what_was_not_measured_is_not_there():
    for case in designs.cases(4):
        trials, again = designs.trials(case), designs.trials(case)
        np.testing.assert_array_equal(trials.speed_m_s, again.speed_m_s)
        run = designs.campaign(case)
        assert len(trials.phi) == len(run.phi) * len(run.omega) * run.replicates
        lost = designs.MEASURED[case.measured]
        assert all(np.isnan(getattr(trials, name)).all() for name in lost)
        assert not np.isnan(trials.speed_m_s).any()


def test_nothing_else_has_a_slow_phase_of_its_own():
    runs = [designs.campaign(case) for case in designs.cases(60)]
    assert {run.gait for run in runs} == {"UNIFORM", "SGCS"}
    assert all((designs.CLOCK in run.truth) == (run.gait == "SGCS") for run in runs)
    assert any(not run.truth for run in runs)


@pytest.mark.parametrize(
    ("status", "named", "outcome"),
    [
        ("adequate", (), "adequate"),
        ("identified", (("belly_coast", "leg_slip"),), "named"),
        ("ambiguous", (("stance_overlap",), ("belly_coast", "cable_drag")), "named"),
        ("partial", (("belly_coast",),), "in part"),
        ("identified", (("stance_overlap",),), "false claim"),
        ("identified", (("belly_coast", "stance_overlap"),), "false claim"),
    ],
)
def test_a_claim_is_judged_by_what_acts(status, named, outcome):
    verdict = SimpleNamespace(status=status, alternatives=named, effects=named[0] if named else ())
    assert designs.outcome(frozenset({"belly_coast", "bed_slope"}), SimpleNamespace(verdict=verdict)) == outcome
