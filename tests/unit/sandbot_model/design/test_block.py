"""The next block: what decides, for what it costs."""

import itertools

import numpy as np

from sandbot_model.design.block import block, expected_information
from sandbot_model.design.explanations import Explanation

PLACES = 3
FREE = np.ones(PLACES)


def explanation(name, *means, unknown=0.0):
    """Predicts ``means`` of the speed at each place; ``unknown``: sd of an offset that all places share."""
    mean = np.zeros((PLACES, 4))
    mean[:, 0] = means
    common = np.zeros((PLACES, 4, PLACES, 4))
    common[:, 0, :, 0] = unknown**2
    return Explanation(name, mean, common)


def test_it_goes_where_rivals_differ():
    rivals = [explanation("a", 0.0, 0.0, 0.0), explanation("b", 0.1, 2.0, 0.5)]
    assert block(rivals, FREE, 1) == [1]


def test_replicates_where_one_place_tells_most_and_others_once_it_is_told():
    assert block([explanation("a", 0, 0, 0), explanation("b", 0.1, 1.5, 0.1)], FREE, 4) == [1, 1, 1, 1]
    three = [explanation("a", 0, 0, 0), explanation("b", 6, 0, 0), explanation("c", 0, 5, 0)]
    assert set(block(three, FREE, 2)) == {0, 1}


def test_what_all_trials_share_is_learnt_from_several_places():
    """An offset that nobody knows hides the difference at one place; the difference of two places shows it."""
    rivals = [explanation("a", 0, 0, 0, unknown=50.0), explanation("b", 3, 0, -3, unknown=50.0)]
    assert set(block(rivals, FREE, 2)) == {0, 2}


def test_a_dear_place_must_tell_more():
    rivals = [explanation("a", 0, 0, 0), explanation("b", 1.0, 1.2, 0)]
    assert block(rivals, FREE, 1) == [1]
    assert block(rivals, np.array([1.0, 3.0, 1.0]), 1) == [0]


def test_more_trials_never_tell_less():
    rivals = [explanation("a", 0, 0, 0, unknown=1.0), explanation("b", 0.5, 1.0, -0.3), explanation("c", 1, 1, 1)]
    told = [float(expected_information(rivals, [[0, 1, 2, 1][:count]])[0]) for count in range(1, 5)]
    assert all(more >= less - 1e-12 for less, more in itertools.pairwise(told))
