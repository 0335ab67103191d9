"""What to measure next: what tells the surviving sets apart, and nothing where nothing does."""

import numpy as np

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import next_trials as module
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.next_trials import NextTrial, next_trials
from sandbot_model.physics.catalogue import catalogue


def test_next_trials_split_what_is_left(drawn):
    """Overlap and slip differ little in mean speed; other observables tell them apart."""
    cells = cells_of(drawn(("stance_overlap",), seed=6))
    overlap, slip = (compare(cells, catalogue(), [name])[-1] for name in ("stance_overlap", "leg_slip"))
    trials = next_trials([overlap, slip])
    assert len(trials) >= 3
    assert trials[0].expected_gap_sd >= trials[-1].expected_gap_sd > 0
    assert trials[0].separates == ("stance_overlap", "leg_slip")
    assert np.isfinite([trial.expected_gap_sd for trial in trials]).all()
    assert all(trial.replicates >= 2 for trial in trials)


def test_a_set_is_not_told_from_itself(drawn):
    fit = compare(cells_of(drawn(seed=6, levels=3)), catalogue()).fit
    assert next_trials([fit, fit]) == []
    assert next_trials([fit]) == []


def test_what_is_told_apart_already_is_worth_two_trials_and_no_more(monkeypatch):
    """Of three sets one differs from the others, by much in one place and by little elsewhere; two hardly do."""
    gaps = {("a", "b"): (50.0, 0.8), ("a", "c"): (50.0, 0.5), ("b", "c"): (0.4, 0.6)}

    def between(first, second):
        pair = first, second
        return [
            NextTrial(0.6, omega, "speed", pair, gap, module._replicates(gap))
            for omega, gap in zip((9.0, 12.0), gaps[pair], strict=True)
        ]

    monkeypatch.setattr(module, "between", between)
    monkeypatch.setattr(module.Predicted, "by", lambda name: name)
    found = {trial.omega_rad_s: (trial.separates, trial.replicates) for trial in next_trials(["a", "b", "c"])}
    assert found == {9.0: (("a", "b"), 2), 12.0: (("b", "c"), 70)}
    assert [trial.omega_rad_s for trial in next_trials(["a", "b"])] == [9.0]
