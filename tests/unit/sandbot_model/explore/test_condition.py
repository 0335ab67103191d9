"""A condition in an address is the same one after a campaign has grown; a number would be another cell."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import made_up_trials

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.selection import Condition, from_query, to_query
from sandbot_model.explore.condition import condition_of, index_of, not_found, option_of


@pytest.fixture(scope="module")
def cells():
    return cells_of(made_up_trials())


@pytest.fixture(scope="module")
def grown():
    """With a looser level, and frequencies between those before."""
    return cells_of(made_up_trials(phis=(0.58, 0.60, 0.615, 0.633), omegas=(4, 7, 10, 16, 19, 22)))


def test_a_condition_stays_what_it_is_while_a_campaign_grows(cells, grown):
    for index in range(len(cells)):
        chosen = condition_of(cells, index)
        again = index_of(grown, chosen)
        assert grown.omega[again] == cells.omega[index]
        assert grown.level_phi[grown.level[again]] == pytest.approx(cells.level_phi[cells.level[index]], abs=1e-3)
    assert index_of(grown, condition_of(cells, 1)) != 1


@given(st.data())
def test_every_cell_is_found_by_its_own_condition(cells, data):
    index = data.draw(st.integers(0, len(cells) - 1))
    query = to_query(from_query(f"?cell={option_of(cells, index)}"))
    assert index_of(cells, from_query(query).cell) == index


def test_old_addresses_hold_the_number_of_a_cell(cells):
    assert index_of(cells, 3) == 3
    assert option_of(cells, 3) == option_of(cells, condition_of(cells, 3))
    assert not_found(cells, 3) == ""


@pytest.mark.parametrize(
    "none", [Condition(0.607, 10, "UNIFORM"), Condition(0.6, 10.2, "UNIFORM"), Condition(0.6, 10, "WAVE"), 999]
)
def test_what_is_none_of_the_trials_is_said_so(cells, none):
    assert index_of(cells, none) is None
    assert option_of(cells, none) is None
    assert not_found(cells, none)


def test_where_none_was_chosen_nothing_is_missing(cells):
    assert (index_of(cells, None), option_of(cells, None), not_found(cells, None)) == (None, None, "")
