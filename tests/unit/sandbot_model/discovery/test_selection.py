"""A selection survives its address and its file, and what makes no sense in either is refused."""

import shlex
from dataclasses import replace

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from made_up import BOOST

from sandbot_common.errors import InputError
from sandbot_model.discovery.selection import VIEWS, Condition, Selection, from_mapping, from_query, to_query, to_yaml
from sandbot_model.physics.observables import NAMES

names = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), min_size=1, max_size=12)

selections = st.builds(
    Selection,
    model=st.sampled_from(["simple", "full"]),
    effects=st.lists(names, unique=True, max_size=4).map(tuple),
    formulas=st.lists(names, unique=True, max_size=2).map(tuple),
    by_hand=st.dictionaries(st.from_regex(r"[a-z_.]{1,12}", fullmatch=True), st.floats(-1e6, 1e6), max_size=3).map(
        lambda held: tuple(held.items())
    ),
    view=st.sampled_from(VIEWS),
    observable=st.sampled_from(NAMES),
    cell=st.none()
    | st.integers(0, 500)
    | st.builds(Condition, st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.just("") | names),
    against=st.just("") | names.map(lambda name: Selection(effects=(name,)).pin().against),
)


@pytest.mark.slow
@given(selection=selections)
def test_a_selection_comes_back_from_its_address(selection):
    assert from_query(to_query(selection)) == selection


@given(selection=selections)
def test_a_selection_comes_back_from_its_file(selection):
    saved = yaml.safe_load(to_yaml(selection, ["trials.csv"], {"rmse_m_s": 0.01}))
    back = from_mapping(saved, "saved.yaml")
    assert back == replace(selection, view="speed", observable="speed", cell=None, against="")


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("?model=best", "model 'best' is not one of simple, full"),
        ("?view=all", "view 'all' is not one of"),
        ("?observable=torque", "observable 'torque'"),
        ("?hold=delta_t_s=nan", "a finite number is needed"),
        ("?hold=delta_t_s", "a finite number is needed"),
        ("?cell=-1", "a whole number is needed"),
        (f"?cell={5000 * '9'}", "cell='9{40}…': .* of at most 9 digits"),
        ("?cell=0.59,20", "φ,ω,gait or a whole number is needed"),
        ("?cell=0.59,nan,UNIFORM", "a finite number is needed"),
        ("?colour=red", "unknown key 'colour'"),
        ("?against=%3Fmodel%3Dbest", "model 'best' is not one of simple, full"),
    ],
)
def test_an_address_that_makes_no_sense_is_refused(query, said):
    with pytest.raises(InputError, match=said):
        from_query(query)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": "other/1"}, "schema is 'other/1'"),
        ({"efects": []}, "unknown key 'efects'"),
        ({"effects": "leg_slip"}, "expected a list of texts"),
        ({"by_hand": [1]}, "expected parameter: value"),
        ({"by_hand": {"delta_t_s": "long"}}, "a finite number is needed"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused(change, said):
    content = yaml.safe_load(to_yaml(Selection(), ["trials.csv"], {})) | change
    with pytest.raises(InputError, match=said):
        from_mapping(content, "saved.yaml")


def test_the_saved_command_names_everything_that_changes_the_numbers():
    selection = Selection("full", ("leg_slip", "boost"), (BOOST,))
    selection = selection.held("leg_slip.sigma", 0.05)
    words = shlex.split(
        yaml.safe_load(to_yaml(selection, ["my data.csv"], {}, ["--effects-from", "mine.py"]))["command"]
    )
    assert words == [
        "compare", "my data.csv", "--effects-from", "mine.py", "--model", "full", "--effects", "leg_slip,boost",
        "--effect", BOOST, "--hold", "leg_slip.sigma=0.05",
    ]  # fmt: skip


def test_a_condition_stands_in_the_address_as_what_was_done():
    chosen = Selection(cell=Condition(0.59, 20.0, "UNIFORM"))
    assert to_query(chosen) == "?cell=0.59,20,UNIFORM"
    assert from_query("?cell=0.590,20,UNIFORM") == chosen
    assert from_query("?cell=0.590%2C20%2CUNIFORM") == chosen
    assert from_query("?cell=3").cell == 3


def test_effects_keep_the_order_in_which_they_were_switched_on():
    selection = Selection().toggled(["leg_slip"]).toggled(["cable_drag", "leg_slip"])
    assert selection.effects == ("leg_slip", "cable_drag")
    assert selection.toggled(["cable_drag"]).effects == ("cable_drag",)


def test_values_held_for_an_effect_go_with_it():
    held = Selection(effects=("leg_slip",)).held("leg_slip.sigma", 0.1).held("delta_t_s", 0.3)
    assert held.toggled([]).by_hand == (("delta_t_s", 0.3),)
    assert held.toggled(["leg_slip"]).by_hand == held.by_hand
