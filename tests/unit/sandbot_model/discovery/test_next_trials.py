"""What to measure next: what tells the surviving sets apart, and nothing where nothing does."""

import numpy as np

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.next_trials import next_trials
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
