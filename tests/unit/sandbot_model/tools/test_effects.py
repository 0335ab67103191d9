"""The catalogue in the terminal."""

import numpy as np
import pytest

from sandbot_model.discovery.fingerprint import SEEN, fingerprint
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.symbols import listed
from sandbot_model.physics.typeset import plain
from sandbot_model.tools import answer, effects


@pytest.fixture
def printed(capsys):
    def run(*arguments):
        assert effects.main(arguments) == 0
        return capsys.readouterr().out

    return run


def test_every_symbol_is_listed_with_its_unit_on_lines_of_a_terminal(printed):
    told = printed("--quantities")
    for symbol in listed():
        (line,) = [one for one in told.splitlines() if one.startswith(", ".join(symbol.spellings) + "  ")
                   and f" {symbol.stage} " in one]  # fmt: skip
        assert f" {symbol.unit} " in line
    assert max(map(len, told.splitlines())) <= 80


@pytest.mark.parametrize(
    "other", [["leg_slip"], ["--json", "q.json"], ["--effect", "x"], ["--effects-from", "none.py"]]
)
def test_beside_the_symbols_nothing_else_is_asked_for(other, capsys):
    assert effects.main(["--quantities", *other]) == 2
    printed = capsys.readouterr()
    assert "--quantities" in printed.err
    assert not printed.out


def shows(card):
    """The observables in which a card says that an effect shows."""
    return {observable.name for observable in Observable if f"  {observable.label}: " in card}


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("stance_overlap", {"lift"}),
        ("leg_slip", {"lift", "peak_speed", "first_step"}),
        ("slow_phase_speed", {"peak_speed"}),
        ("belly_coast", {"speed", "lift", "first_step"}),
        # What k(φ) absorbs, no trial shows: docs/physics.md §7.
        ("cohesion", set()),
        ("depth_nonlinearity", set()),
    ],
)
def test_a_card_says_where_an_effect_would_show(name, where, printed):
    told = printed(name)
    assert told.startswith(f"{name}\n  {answer.words(catalogue()[name])}\n")
    assert shows(told) == where
    assert ("would not show" in told) == (not where)
    assert f"source {catalogue()[name].source}" in " ".join(told.split())
    assert max(map(len, told.splitlines())) <= 80


def test_a_fingerprint_of_nothing_is_empty():
    nothing = formula_effect("nothing: strength: k*(1 + 0*a); a [1] in 0..1", tried=True)
    assert np.abs(fingerprint(nothing, {"nothing": nothing}).missed).max() < SEEN / 4


def test_a_formula_of_ones_own_has_a_card(printed):
    told = printed("loss", "--effect", "loss: speed: v -> v*(1 - eta); eta [1] in 0..0.2")
    assert "v → v·(1 - η)" in told
    assert shows(told) == {"lift"}


@pytest.mark.parametrize("name", ["stance_overlap", "depth_nonlinearity", "exact_vertical_acceleration"])
def test_what_a_card_shows_may_be_typed(name):
    effect = catalogue()[name]
    shown = plain(effect.formula.split(":")[0]).replace("η", "eta")
    own = "".join(f"; {one.symbol or one.name} in 1..2" for one in effect.parameters)
    assert formula_effect(f"x: {effect.stage}: {shown}{own}").stage == effect.stage


def test_a_misspelt_name_is_answered_with_the_one_that_may_be_meant(capsys):
    assert effects.main(["leg slip"]) == 2
    assert "did you mean 'leg_slip'?" in capsys.readouterr().err
