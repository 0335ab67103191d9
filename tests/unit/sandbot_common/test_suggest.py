import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.suggest import did_you_mean, near

EFFECTS = ("leg_slip", "stance_overlap", "belly_coast", "bed_slope")


@pytest.mark.parametrize("typed", ["leg_slip", "leg slip", "Leg-Slip", "legslip", "leg_slipp", " leg_slp"])
def test_a_slip_of_the_finger_is_understood(typed):
    assert did_you_mean(typed, EFFECTS) == ", did you mean 'leg_slip'?"


def test_the_last_part_of_a_name_is_understood():
    assert near("eta", ["delta_t_s", "stance_overlap.eta"]) == "stance_overlap.eta"


def test_what_is_like_nothing_is_answered_with_all_there_is():
    assert did_you_mean("gravity", EFFECTS) == f"; known: {', '.join(EFFECTS)}"
    assert near("gravity", EFFECTS) == ""
    assert did_you_mean("gravity", []) == "; known: none"
    assert did_you_mean("gravity", map(str, range(105))).endswith(", 28, 29, ... (105 in all)")


def test_a_short_name_is_not_found_in_the_letters_of_a_long_one():
    assert near("eta", ["delta_t_s", "k_f"]) == ""
    assert near("phj", ["phi", "k"]) == "phi"


def test_a_common_file_ending_makes_nothing_alike():
    assert near("nosuch.yaml", ["sgcs.yaml", "demo.yaml"]) == ""
    assert near("dmo.yaml", ["sgcs.yaml", "demo.yaml"]) == "demo.yaml"


@given(st.text(max_size=20), st.lists(st.text(max_size=10), max_size=5))
def test_what_is_suggested_is_always_known(typed, known):
    assert near(typed, known) in {"", *known}
