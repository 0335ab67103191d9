"""Evidence that holds however often it is looked at."""

import math

import numpy as np
import pytest

from sandbot_model.design.evidence import at_every_look, lack_of_fit_at
from sandbot_model.discovery.criteria import DEFAULT

EFFECTS, BLOCKS, CAMPAIGNS = 25, 30, 1500
"""Directions that may be claimed, looks at a campaign, campaigns drawn."""


def ever_claimed(rng, claim, truth=0.0):
    """Whether the best of ``EFFECTS`` directions ever gains ``claim`` in deviance, looked at after every block."""
    slopes = rng.standard_normal((BLOCKS, EFFECTS, 6))
    missed = rng.standard_normal((BLOCKS, 6)) + truth * slopes[:, 0]
    pull = np.cumsum(np.einsum("bek,bk->be", slopes, missed), axis=0)
    information = np.cumsum(np.sum(slopes**2, axis=-1), axis=0)
    return bool((pull**2 / information > claim).any())


def rate(claim, truth=0.0):
    return np.mean([ever_claimed(np.random.default_rng(seed), claim, truth) for seed in range(CAMPAIGNS)])


@pytest.mark.parametrize("alpha", [0.02, 0.1])
def test_of_thirty_looks_at_nothing_at_most_alpha_ever_claim(alpha):
    claim = 2 * math.log(EFFECTS / alpha) + math.log1p(45**2)
    assert rate(claim) <= alpha
    assert at_every_look(alpha, EFFECTS, DEFAULT).claim >= claim


def test_a_claim_that_is_right_for_one_look_is_made_too_often_in_thirty():
    one_look = 2 * math.log(EFFECTS / 0.1)
    assert rate(one_look) > rate(one_look + math.log1p(45**2))
    assert rate(6.6) > 0.3  # the 1 % point of one effect at one look


def test_an_effect_that_is_there_is_claimed():
    assert rate(at_every_look(0.02, EFFECTS, DEFAULT).claim, truth=0.8) > 0.99


def test_a_smaller_alpha_and_more_effects_ask_for_more():
    usual = at_every_look(0.02, EFFECTS, DEFAULT).claim
    assert usual == pytest.approx(22.0, abs=0.5)
    assert at_every_look(0.001, EFFECTS, DEFAULT).claim > usual
    assert at_every_look(0.02, 500, DEFAULT).claim > usual


def test_all_looks_together_spend_alpha():
    assert sum(lack_of_fit_at(look, 0.02) for look in range(1, 10_000)) == pytest.approx(0.02, rel=1e-3)
