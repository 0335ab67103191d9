"""What the controls of the page do to the selection."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import BOOST

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.selection import Condition, Selection
from sandbot_model.explore import views
from sandbot_model.explore.actions import (
    act,
    clicked_cell,
    slider_value,
    values_of,
    with_controls,
    with_sliders,
    with_verdict,
)
from sandbot_model.explore.condition import condition_of
from sandbot_model.report.theme import LIGHT


def test_controls_change_what_they_name_and_nothing_else():
    start = Selection(effects=("leg_slip",)).held("delta_t_s", 0.3)
    assert act(start, "view", "lock") == replace(start, view="lock")
    assert act(start, "cell", "0.6,20,UNIFORM") == replace(start, cell=Condition(0.6, 20, "UNIFORM"))
    assert act(replace(start, cell=3), "cell", None) == start
    assert act(start, "release", 1) == replace(start, by_hand=())
    assert act(start, "model", "full") == replace(start, model="full", by_hand=())
    assert act(start, "unheard of", 1) == start


@pytest.mark.slow
def test_what_discovery_found_is_switched_on(session, drawn):
    start = Selection(effects=("leg_slip",), by_hand=(("delta_t_s", 0.3),))
    hidden = "hidden: speed: kept, peak_ratio *= 1 - a*where(omega > 14, 1, 0); a [1] in 0.1..0.3"
    found = discover(cells_of(drawn(levels=3, formulas=[hidden])), {}, max_effects=0)
    named = replace(found, verdict=replace(found.verdict, effects=("cable_drag",)))
    assert with_verdict(start, named) == Selection(effects=("cable_drag",))
    # Nothing of the catalogue fits: the residual is added as a formula, on top of what it was fitted with.
    assert found.verdict.effects == ()
    assert found.residual is not None
    adopted = with_verdict(start, replace(found, residual=replace(found.residual, effects=("dilation",))))
    assert adopted.effects == ("dilation", "residual")
    assert adopted.formulas == (found.residual.formula,)
    assert "residual" in session.catalogue(adopted.formulas)
    assert with_verdict(start, replace(found, residual=None)) == Selection()


def test_a_control_used_adds_to_what_was_asked_for_and_is_not_shown_yet(session):
    def stand(selection):
        return values_of(selection, session.cells)

    def with_told(selection, told, values):
        return with_controls(selection, stand(told), stand(values))

    cell = condition_of(session.cells, 2)
    shown = Selection(effects=("leg_slip", "cable_drag"))
    asked = replace(shown.toggled(["cable_drag", "dilation"]), view="lock", by_hand=(("delta_t_s", 0.3),))
    assert with_told(asked, shown, shown) == asked
    both = with_told(asked, shown, replace(shown, cell=cell).toggled(["leg_slip", "cable_drag", "cohesion"]))
    assert both == replace(asked, effects=("cable_drag", "dilation", "cohesion"), cell=cell)
    assert with_told(asked, shown, shown.toggled(["leg_slip"])).effects == ("dilation",)
    assert with_told(shown, shown, asked) == replace(asked, by_hand=())
    assert with_told(asked, asked, replace(asked, model="full")).by_hand == ()


def test_a_model_set_beside_stays_while_the_other_changes():
    pinned = act(Selection(effects=("leg_slip",), view="lock"), "pin", 1)
    changed = act(act(pinned, "effects", []), "model", "full")
    assert changed.other == Selection(effects=("leg_slip",), view="lock")
    assert act(changed, "unpin", 1).other is None
    assert Selection().other is None
    assert Selection().pin().other == Selection()


def test_a_formula_is_added_switched_on_and_replaced_by_name():
    added = act(Selection(effects=("leg_slip",)), "formula", BOOST)
    assert added.effects == ("leg_slip", "boost")
    replaced = act(added, "formula", BOOST.replace("-5..5", "-2..2"))
    assert replaced.effects == ("leg_slip", "boost")
    assert len(replaced.formulas) == 1
    with pytest.raises(InputError):
        act(added, "formula", "not a formula")


def test_only_a_slider_that_was_moved_holds_its_parameter():
    shown = {"delta_t_s": 0.4, "v_swim_m_s": 0.02}
    assert with_sliders(Selection(), shown, dict(shown)) == Selection()
    assert with_sliders(Selection(), shown, shown | {"delta_t_s": 0.3}).by_hand == (("delta_t_s", 0.3),)


@given(st.floats(1e-6, 1e3), st.floats(1e-6, 1e3))
def test_moving_one_slider_never_holds_another(delta_t, eta):
    """Whatever their values are rounded to beside the slider."""
    shown = {"delta_t_s": delta_t, "stance_overlap.eta": eta}
    moved = {"delta_t_s": slider_value(1.1 * delta_t), "stance_overlap.eta": slider_value(eta)}
    assert [name for name, _ in with_sliders(Selection(), shown, moved).by_hand] == ["delta_t_s"]


def test_a_click_names_its_cell(session):
    cells = session.cells
    assert clicked_cell({"points": [{"customdata": [3, 7]}]}, cells) == 7
    for none in (None, {}, {"points": []}, {"points": [{"x": 1}]}, {"points": [{"customdata": [2.1, None]}]}):
        assert clicked_cell(none, cells) is None


def test_a_click_on_the_map_names_its_cell_by_row_and_column(session):
    spec = views.show(session, Selection(view="residuals"), LIGHT).figure["data"][-1]
    for row, label in enumerate(spec["y"]):
        for column, omega in enumerate(spec["x"]):
            found = clicked_cell({"points": [{"x": omega, "y": label, "z": 0.0}]}, session.cells)
            assert found == spec["customdata"][row][column][1]
    assert clicked_cell({"points": [{"x": "99", "y": spec["y"][0]}]}, session.cells) is None
