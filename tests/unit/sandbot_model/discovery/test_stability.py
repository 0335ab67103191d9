import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.stability import win_shares
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.variants import with_variants


def test_the_right_set_wins_nearly_always_and_twins_share(drawn):
    cells = cells_of(drawn(("stance_overlap",), seed=6))
    base, right = compare(cells, catalogue(), ["stance_overlap"])
    wrong = compare(cells, catalogue(), ["swimming_thrust"])[-1]
    shares = win_shares([base, right, wrong], np.random.default_rng(1))
    assert shares[1] > 0.95
    assert sum(shares) == pytest.approx(1.0)


def test_a_useless_effect_does_not_win(drawn):
    cells = cells_of(drawn(seed=6))
    base, more = compare(cells, catalogue(), ["stance_overlap"])
    shares = win_shares([base, more], np.random.default_rng(1))
    assert shares[0] > 0.6


def test_a_convention_that_fits_as_well_wins_only_where_its_selection_is_paid_for(drawn):
    """A slip that spares the peak is an overlap but for how it falls with depth."""
    cells = cells_of(drawn(("stance_overlap",), seed=6))
    spared = with_variants({"leg_slip": "the peak spared"}, catalogue())
    right, alike = (compare(cells, spared, [name])[-1] for name in ("stance_overlap", "leg_slip"))
    assert abs(alike.bic - right.bic) < 10
    share, _ = win_shares([right, alike], np.random.default_rng(1))
    assert 0.9 < share <= 1.0
