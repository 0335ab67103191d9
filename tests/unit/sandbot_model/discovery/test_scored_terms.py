"""The score test of a library of terms: what is planted leads, what the fit absorbs or noise makes is not proposed."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.scored_terms import COLLINEAR, PER_LEVER, guesses, unused_name
from sandbot_model.discovery.term_library import terms
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.jacobian import tangent_basis
from sandbot_model.physics.model import model_of


def base(drawn, **how):
    return fit(model_of("simple", (), {}), cells_of(drawn(levels=4, omega=(6, 10, 14, 18), **how)))


@pytest.fixture(scope="module")
def planted(drawn):
    formula = "hidden: speed: kept, peak_ratio *= 1 - a*where(omega > 12, 1, 0); a [1] in 0.15..0.16"
    return base(drawn, seed=3, formulas=[formula])


def test_what_is_planted_is_among_the_best_of_its_lever(planted):
    found = guesses(planted, "residual", terms(planted), None, DEFAULT.term)
    best = max(found, key=lambda guess: guess.gain)
    assert best.lever.words == "the speed at every moment of a step"
    steps = [guess for guess in found if guess.terms[0].words == "{} above ω = 12 rad/s"]
    assert [guess.coefficients[0] for guess in steps if guess.lever == best.lever] == pytest.approx([-0.155], rel=0.25)


def test_few_are_proposed_a_lever_and_no_two_say_the_same(planted):
    found = guesses(planted, "residual", terms(planted), None, DEFAULT.term)
    for lever in {guess.lever for guess in found}:
        own = [guess for guess in found if guess.lever == lever]
        assert len(own) <= PER_LEVER
        for i, one in enumerate(own):
            assert all(abs(one.direction @ other.direction) < COLLINEAR for other in own[i + 1 :])


def test_a_direction_is_orthogonal_to_what_the_fit_absorbs(planted):
    basis = tangent_basis(planted.problem, planted.state)
    for guess in guesses(planted, "residual", terms(planted), None, DEFAULT.term):
        assert np.abs(basis.T @ guess.direction).max() < 1e-8
        assert np.linalg.norm(guess.direction) == pytest.approx(1.0)


def test_noise_alone_proposes_nothing(drawn):
    null = base(drawn, seed=1)
    assert guesses(null, "residual", terms(null), None, DEFAULT.term) == []


def test_a_name_in_use_gets_a_number():
    assert unused_name("residual", ["leg_slip"]) == "residual"
    assert unused_name("residual", ["residual", "residual_2"]) == "residual_3"
