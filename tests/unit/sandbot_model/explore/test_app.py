"""The page without a browser: its outputs, its address, its second pane, and who may ask for it."""

import csv
import io
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import pytest
import yaml
from dash import no_update
from dash.exceptions import PreventUpdate
from inline import Inline
from made_up import made_up_trials

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.selection import Selection, from_mapping, from_query, to_query
from sandbot_model.explore import app, effect_list, no_data
from sandbot_model.explore.actions import values_of
from sandbot_model.explore.app import SHOWN, Beside, Explorer
from sandbot_model.explore.session import Session
from sandbot_model.physics.typeset import mathml_in_pieces


def test_the_page_shows_one_value_for_each_output(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.fit_ahead = lambda selection: None
    values = explorer.show(Selection(effects=("leg_slip",), cell=1), "dark")
    assert set(values) == set(SHOWN)
    assert "leg slip" in values["status.children"]
    assert values["message.children"] == ""
    explorer.app()


def test_an_address_says_where_the_controls_stand_for_it(session, trials, tmp_path, monkeypatch):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.fit_ahead = lambda selection: None
    made = {}
    monkeypatch.setattr(app, "set_props", made.__setitem__)
    explorer.on_address("?effect=leg_slip&cell=1", "dark", [], [])
    assert made["shown"]["data"]["search"] == "?effect=leg_slip&cell=1"
    stand = made["shown"]["data"]["controls"]
    assert stand == values_of(Selection(effects=("leg_slip",), cell=1), session.cells)
    assert stand["effects"] == ["leg_slip"]
    # An old address: the list of conditions knows them by what was done.
    assert stand["cell"] == "0.6,10,UNIFORM"


class Browser:
    """A page as the server sees it: its address, its controls, and what it was told; answers come when they come."""

    def __init__(self, explorer, monkeypatch):
        self.explorer = explorer
        self.at = {"search": "", "reported": values_of(Selection(), explorer.session.cells)}
        self.values = dict(self.at["reported"])
        monkeypatch.setattr(app, "ctx", SimpleNamespace(triggered=[], triggered_prop_ids={}))
        self.monkeypatch = monkeypatch

    def asks(self):
        """A request with the page as it is now; its answer is taken in when it is called."""
        answer = {}
        self.monkeypatch.setattr(app, "set_props", lambda name, given: answer.update({name: given}))
        shown = {"search": "", "controls": values_of(Selection(), self.explorer.session.cells)}
        self.explorer.on_control(
            dict(self.values), [], [], None, [], None, self.at["search"], shown, self.at["reported"]
        )

        def comes():
            self.at["search"] = answer.get("address", self.at)["search"]
            self.at["reported"] = answer["reported"]["data"] if "reported" in answer else self.at["reported"]

        return comes


@pytest.mark.parametrize("late", [False, True])
def test_what_is_switched_on_and_off_before_figures_come_is_off(session, trials, tmp_path, monkeypatch, late):
    """Compared with what was displayed last, "off" was no change: the box said off, the address on, for good."""
    page = Browser(Explorer(session, trials, [tmp_path / "trials.csv"], "test"), monkeypatch)
    page.values["effects"] = ["leg_slip"]
    on = page.asks()
    if not late:
        on()
        assert page.at["search"] == "?effect=leg_slip"
    page.values["effects"] = []
    off = page.asks()
    if late:
        on()
    off()
    # The page asks again while a control stands where it was not told (settle in explore.js).
    if page.values != page.at["reported"]:
        page.asks()()
    assert page.at == {"search": "", "reported": page.values}


def test_the_sheet_holds_the_values_held_by_hand(session, trials, tmp_path, monkeypatch):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    monkeypatch.setattr(app, "ctx", SimpleNamespace(triggered_id="save-csv"))
    held = Selection(effects=("leg_slip",)).held("delta_t_s", 0.35)
    plain, saved = (
        list(csv.DictReader(io.StringIO(explorer.on_save(0, 1, to_query(one))["content"])))
        for one in (replace(held, by_hand=()), held)
    )
    name = "speed_m_s[leg_slip; held by hand: delta_t_s=0.35]"
    drawn = session.step(held).fit.predicted[:, 0]
    assert [float(row[name]) for row in saved] == pytest.approx(drawn, rel=1e-6)
    assert [float(row["speed_m_s[leg_slip]"]) for row in saved] != pytest.approx(drawn, rel=1e-3)
    assert [{key: row[key] for key in plain[0]} for row in saved] == plain


def test_a_condition_that_is_none_of_the_trials_is_said_so(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.fit_ahead = lambda selection: None
    for query, said in (("?cell=0.7,10,UNIFORM", "No trial at φ 0.700, ω 10 rad/s, gait UNIFORM"),
                        ("?cell=99", "12 conditions: none has the number 99")):  # fmt: skip
        assert said in str(explorer.show(from_query(query), "dark")["trials.children"])
    assert explorer.show(Selection(), "dark")["trials.children"] is None


def test_sliders_that_stand_where_they_should_are_not_made_anew(session, trials, tmp_path, monkeypatch):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.fit_ahead = lambda selection: None
    said = []
    monkeypatch.setattr(app, "set_props", lambda *given: said.append(given))
    held = Selection(view="parameters", by_hand=(("delta_t_s", 0.3),))
    made = explorer.show(held, "dark")["by-hand.children"]
    at = {one.children[1].id["by_hand"]: one.children[1].value for one in made}
    assert set(at) == {"delta_t_s", "v_swim_m_s"}
    assert explorer.show(held, "dark", at)["by-hand.children"] is no_update
    assert said == [({"held": "delta_t_s"}, {"hidden": False}), ({"held": "v_swim_m_s"}, {"hidden": True})]
    assert len(explorer.show(held, "dark", at | {"delta_t_s": 0.31})["by-hand.children"]) == 2


def test_the_saved_file_carries_the_numbers_shown(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    selection = Selection(effects=("leg_slip",))
    saved = yaml.safe_load(explorer.saved(selection))
    assert saved["result"]["rmse_m_s"] == pytest.approx(session.step(selection).fit.rmse_m_s, rel=1e-3)
    assert from_mapping(saved, "saved.yaml") == selection


def test_a_discovery_that_fails_says_so(session, trials, tmp_path, monkeypatch):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")

    def refuse(*_):
        raise InputError("no replicates")

    monkeypatch.setattr(session, "suggest", refuse)
    explorer.job.start(Selection()).join(60)
    assert not explorer.job.running
    assert explorer.job.failed_for(Selection()) == "No suggestion: no replicates"


def test_a_limit_of_the_data_stands_on_the_page(tmp_path):
    trials = made_up_trials(phis=(0.633,))
    explorer = Explorer(Session(cells_of(trials), Inline()), trials, [tmp_path / "x.csv"], "one phi")
    assert "every trial is at φ = 0.633" in str(explorer.app().layout)


def test_what_is_odd_about_the_data_stands_on_the_page(session, trials, tmp_path):
    copied = trials.speed_m_s.copy()
    copied[:40] = 0.0
    odd = replace(trials, speed_m_s=copied)
    said = "Check the data. "
    assert said in str(Explorer(Session(cells_of(odd), Inline()), odd, [tmp_path / "x.csv"], "odd").app().layout)
    assert said not in str(Explorer(session, trials, [tmp_path / "x.csv"], "clean").app().layout)


def test_formulas_are_typeset_by_the_page(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "x.csv"], "formulas")
    session.fit_ahead = lambda selection: None
    options = explorer.show(Selection(), "light")["effects.options"]
    shown = {option["value"]: option["label"].to_plotly_json()["props"]["data-html"] for option in options}
    effects = session.catalogue()
    assert set(shown) <= set(effects)
    for name, label in shown.items():
        assert mathml_in_pieces(effects[name].formula) in label
    assert mathml_in_pieces(effects["leg_slip"].formula) not in shown["cable_drag"]


def test_previews_are_those_of_the_address_and_none_come_before_it(session, trials, tmp_path):
    """A slow page's first tick came before its figures: the effects of the base model stood beside another one's."""
    explorer = Explorer(session, trials, [tmp_path / "x.csv"], "test")
    session.fit_ahead = lambda selection: None
    with pytest.raises(PreventUpdate):
        explorer.on_preview_clock(1, None)
    on = '<small class="values">'
    for query, count in (("", 0), ("?effect=leg_slip", 1)):
        options = explorer.on_preview_clock(1, query)["effects.options"]
        assert sum(on in option["label"].to_plotly_json()["props"]["data-html"] for option in options) == count


def test_data_that_show_nothing_get_a_page_that_says_why():
    page = no_data.app("<lab>", "trials.csv: no trials: nothing below the header").test_client()
    answer = page.get("/", headers={"Host": "127.0.0.1:8050"})
    assert answer.status_code == 200
    assert "nothing below the header" in answer.text
    assert 'role="alert"' in answer.text
    assert "&lt;lab&gt;" in answer.text
    assert page.get("/", headers={"Host": "elsewhere.example"}).status_code == 403


def test_a_second_data_set_is_shown_with_the_same_effects(session, trials, tmp_path):
    other = Session(cells_of(made_up_trials(phis=(0.61, 0.62))), Inline())
    other.fit_ahead = session.fit_ahead = lambda selection: None
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "first", Beside(other, "the other lab"))
    values = explorer.show(Selection(effects=("leg_slip",), cell=1), "light")
    assert values["pane-title.children"] == "first: + leg slip"
    beside = str(values["beside.children"])
    assert "the other lab" in beside
    assert "leg slip" in beside


def shown_by(explorer, selection):
    return explorer.show(selection, "light")


def test_two_models_stand_side_by_side_on_axes_that_end_alike(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "lab")
    session.fit_ahead = lambda selection: None
    alone = shown_by(explorer, Selection())
    assert (alone["beside.children"], alone["pane-title.hidden"], alone["unpin.hidden"]) == ([], True, True)
    both = shown_by(explorer, Selection(effects=("leg_slip",)).pin().toggled(["stance_overlap"]))
    assert (both["pane-title.children"], both["pane-title.hidden"]) == ("+ stance overlap", False)
    pane, apart = both["beside.children"]
    assert apart.children[0].children == "Difference of the two"
    title, body = pane.children
    assert title.children == "+ leg slip, second model"
    other = body.children[0].children.figure
    assert other["layout"]["yaxis"]["range"] == both["figure.figure"]["layout"]["yaxis"]["range"]
    assert not both["unpin.hidden"]


def test_only_this_host_is_answered(session, trials, tmp_path):
    client = Explorer(session, trials, [tmp_path / "x.csv"], "test").app().server.test_client()
    assert client.get("/", headers={"Host": "127.0.0.1:8050"}).status_code == 200
    assert client.get("/", headers={"Host": "elsewhere.example"}).status_code == 403


def test_a_page_of_another_site_asks_in_vain(session, trials, tmp_path):
    client = Explorer(session, trials, [tmp_path / "x.csv"], "test").app().server.test_client()

    def asked(**headers):
        host = {"Host": "127.0.0.1:8050"}
        return client.post("/_dash-update-component", json={}, headers=host | headers).status_code

    for origin in ("http://elsewhere.example", "null", "http://127.0.0.1:9000", "https://127.0.0.1:8050"):
        assert asked(Origin=origin) == 403
    assert asked(Origin="http://127.0.0.1:8050", Host="elsewhere.example:8050") == 403
    assert asked(Origin="http://127.0.0.1:8050") != 403
    assert asked() != 403


@pytest.mark.parametrize("path", ["../x.csv", "..%2fx.csv", "%2e%2e/x.csv", "....//x.csv", "/x.csv", "x.csv%00"])
@pytest.mark.parametrize("below", ["", "assets/", "bag/", "bag/a/", "clip/", "_dash-component-suites/dash/"])
def test_no_path_leads_out_of_the_page(below, path, session, trials, tmp_path):
    (tmp_path / "x.csv").write_text("a secret")
    client = Explorer(session, trials, [tmp_path / "t" / "x.csv"], "test").app().server.test_client()
    for tried in (f"/{below}{path}", f"/{below}{'..%2f' * 12}{tmp_path}/x.csv", f"/{below}{tmp_path}/x.csv"):
        assert b"a secret" not in client.get(tried, headers={"Host": "127.0.0.1"}).data


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("", None),
        ("boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5", "a from -5 to 5"),
        ("boost: strength: k*(1 + a*(phj - 0.6)); a [1] in -5..5", "did you mean 'phi'?"),
        ("boost", "expected 'name: stage: formula"),
    ],
)
def test_a_formula_is_read_while_it_is_typed(typed, said):
    found = str(effect_list.formula_read(typed))
    assert found == "[]" if said is None else said in found
    assert ("data-html" in found) == (said is not None and said.startswith("a from"))


def test_an_address_that_means_nothing_is_refused_in_a_line_by_every_page(session, trials, tmp_path):
    client = Explorer(session, trials, [tmp_path / "x.csv"], "test").app().server.test_client()
    pages = ("/atlas", "/atlas/fig2a_speed_omega.svg", "/effects", "/trial", "/why", "/why/progress")
    for page, query in product(pages, ("tune=1", f"cell={5000 * '9'}")):
        answer = client.get(f"{page}?{query}", headers={"Host": "127.0.0.1"})
        assert (answer.status_code, len(answer.text.splitlines())) == (400, 1), page
    for page in ("/atlas", "/effects", "/why"):
        assert client.get(f"{page}?effect=nonsense", headers={"Host": "127.0.0.1"}).status_code == 400
