"""The catalogue in the terminal."""

import pytest

from sandbot_model.physics.symbols import listed
from sandbot_model.tools import effects


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
