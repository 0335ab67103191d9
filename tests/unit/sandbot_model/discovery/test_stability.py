import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.stability import win_shares
from sandbot_model.physics.catalogue import catalogue


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
