"""The explorer without a browser: the selection survives its address and its file, fits are those of ``compare``."""

import shlex
import socket
import time
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_model.cells import OBSERVABLES, cells_of
from sandbot_model.compare import compare
from sandbot_model.effects import CATALOGUE
from sandbot_model.explore import views, waveforms
from sandbot_model.explore.actions import act, clicked_cell, moved
from sandbot_model.explore.app import SHOW_OUTPUTS, Beside, Explorer
from sandbot_model.explore.selection import VIEWS, Selection, from_mapping, from_query, to_query, to_yaml
from sandbot_model.explore.session import Session
from sandbot_model.model import model_of
from sandbot_model.report.theme import LIGHT
from sandbot_model.tools import explore as explore_tool
from sandbot_model.walking import Inputs
from sandbot_record.trials import Row, from_rows, write_csv

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
BOOST = "boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5"


class Inline(Executor):
    """Does the work at once, in this process."""

    def submit(self, function, /, *arguments, **named):
        future = Future()
        try:
            future.set_result(function(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


class Never(Executor):
    """Workers that are always busy: nothing submitted ever begins."""

    def submit(self, function, /, *arguments, **named):
        return Future()


def made_up_trials(phis=(0.60, 0.615, 0.633), replicates=2, omegas=(4, 10, 16, 22), lift=True):
    rng = np.random.default_rng(1)
    phi, omega, replicate = (a.ravel() for a in np.meshgrid(phis, omegas, range(replicates), indexing="ij"))
    k = np.interp(phi, [0.58, 0.60, 0.633], [170, 185, 220])
    values = model_of("simple", (), EFFECTS).walker.predict(Inputs(k, omega, 0.4, phi)).observables
    values = values + rng.normal(0, 1, values.shape) * [0.005, 0.0002, 0.008, 0.002]
    return from_rows(
        [
            Row(
                trial_id=f"t{i:02d}",
                phi=float(phi[i] + rng.normal(0, 2e-4)),
                omega_rad_s=float(omega[i]),
                gait="UNIFORM",
                replicate=float(replicate[i]),
                speed_m_s=float(values[i, 0]),
                lift_m=float(values[i, 1]) if lift else np.nan,
                peak_speed_m_s=float(values[i, 2]),
                first_step_m=float(values[i, 3]),
            )
            for i in range(len(phi))
        ]
    )


@pytest.fixture(scope="module")
def trials():
    return made_up_trials()


@pytest.fixture(scope="module")
def session(trials):
    return Session(cells_of(trials), Inline())


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
    observable=st.sampled_from(OBSERVABLES),
    cell=st.none() | st.integers(0, 500),
)


@given(selection=selections)
def test_a_selection_comes_back_from_its_address(selection):
    assert from_query(to_query(selection)) == selection


@given(selection=selections)
def test_a_selection_comes_back_from_its_file(selection):
    saved = yaml.safe_load(to_yaml(selection, ["trials.csv"], {"rmse_m_s": 0.01}))
    back = from_mapping(saved, "saved.yaml")
    assert back == replace(selection, view="speed", observable="speed", cell=None)


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("?model=best", "model 'best' is not one of simple, full"),
        ("?view=all", "view 'all' is not one of"),
        ("?observable=torque", "observable 'torque'"),
        ("?hold=delta_t_s=nan", "a finite number is needed"),
        ("?hold=delta_t_s", "a finite number is needed"),
        ("?cell=-1", "a whole number is needed"),
        ("?colour=red", "unknown key 'colour'"),
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
    words = shlex.split(yaml.safe_load(to_yaml(selection, ["my data.csv"], {}))["command"])
    assert words == ["compare", "my data.csv", "--model", "full", "--effects", "leg_slip,boost", "--effect", BOOST]


def test_effects_keep_the_order_in_which_they_were_switched_on():
    selection = Selection().toggled(["leg_slip"]).toggled(["cable_drag", "leg_slip"])
    assert selection.effects == ("leg_slip", "cable_drag")
    assert selection.toggled(["cable_drag"]).effects == ("cable_drag",)


def test_values_held_for_an_effect_go_with_it():
    held = Selection(effects=("leg_slip",)).held("leg_slip.sigma", 0.1).held("delta_t_s", 0.3)
    assert held.toggled([]).by_hand == (("delta_t_s", 0.3),)
    assert held.toggled(["leg_slip"]).by_hand == held.by_hand


def test_controls_change_what_they_name_and_nothing_else():
    start = Selection(effects=("leg_slip",)).held("delta_t_s", 0.3)
    assert act(start, "view", "lock") == replace(start, view="lock")
    assert act(start, "cell", 3) == replace(start, cell=3)
    assert act(start, "release", 1) == replace(start, by_hand=())
    assert act(start, "model", "full") == replace(start, model="full", by_hand=())
    assert act(start, "adopt", ("cable_drag",)).effects == ("cable_drag",)
    assert act(start, "unheard of", 1) == start


def test_a_formula_is_added_switched_on_and_replaced_by_name():
    once = act(Selection(effects=("leg_slip",)), "formula", BOOST)
    assert once.effects == ("leg_slip", "boost")
    again = act(once, "formula", BOOST.replace("-5..5", "-2..2"))
    assert again.effects == ("leg_slip", "boost")
    assert len(again.formulas) == 1
    with pytest.raises(InputError):
        act(once, "formula", "not a formula")


def test_only_a_slider_that_was_moved_holds_its_parameter():
    shown = {"delta_t_s": 0.4, "v_swim_m_s": 0.02}
    assert moved(Selection(), shown, dict(shown)) == Selection()
    assert moved(Selection(), shown, shown | {"delta_t_s": 0.3}).by_hand == (("delta_t_s", 0.3),)


def test_a_click_names_its_cell():
    assert clicked_cell({"points": [{"customdata": [3, 17]}]}) == 17
    for nothing in (None, {}, {"points": []}, {"points": [{"x": 1}]}, {"points": [{"customdata": [2.1, None]}]}):
        assert clicked_cell(nothing) is None


def test_the_ladder_is_that_of_compare(session):
    selection = Selection(effects=("leg_slip", "stance_overlap"))
    ours = [step.fit for step in session.ladder(selection)]
    theirs = compare(session.cells, EFFECTS, selection.effects)
    for one, other in zip(ours, theirs, strict=True):
        assert one.effects == other.effects
        assert one.rmse_m_s == pytest.approx(other.rmse_m_s, rel=1e-3)
        assert one.deviance == pytest.approx(other.deviance, abs=0.05)


def test_a_set_fitted_once_is_not_fitted_again(session, monkeypatch):
    selection = Selection(effects=("leg_slip",))
    first = session.ladder(selection)
    monkeypatch.setattr("sandbot_model.explore.session.fit", None)
    assert session.ladder(selection) == first


def test_what_no_worker_has_begun_is_fitted_here(trials):
    session = Session(cells_of(trials), Never())
    session.ahead(Selection())
    assert set(session.promises(Selection()).values()) == {None}
    assert session.ladder(Selection(effects=("leg_slip",)))[-1].fit.effects == ("leg_slip",)
    assert session.promises(Selection())["leg_slip"] is not None


def test_promises_are_the_errors_that_come_true(trials):
    small = Session(cells_of(trials), Inline())
    small.catalogue = lambda formulas=(): {name: EFFECTS[name] for name in ("leg_slip", "cable_drag")}
    start = Selection(effects=("leg_slip",))
    small.ladder(start)
    small.ahead(start)
    promises = small.promises(start)
    assert set(promises) == {"leg_slip", "cable_drag"}
    on = small.ladder(start.toggled(["leg_slip", "cable_drag"]))[-1].fit
    off = small.ladder(Selection())[-1].fit
    assert promises["cable_drag"] == pytest.approx((on.rmse_m_s, on.cv_rmse_m_s), rel=1e-6)
    assert promises["leg_slip"] == pytest.approx((off.rmse_m_s, off.cv_rmse_m_s), rel=1e-6)


def test_a_value_held_by_hand_is_what_the_figures_show(session):
    fitted = session.shown(Selection())
    best = fitted.fit.parameters["delta_t_s"].value
    held = session.shown(Selection().held("delta_t_s", 0.5 * best))
    assert held.fit.parameters["delta_t_s"].value == pytest.approx(0.5 * best)
    assert held.fit.rmse_m_s > fitted.fit.rmse_m_s
    same = session.shown(Selection().held("delta_t_s", best))
    assert same.fit.rmse_m_s == pytest.approx(fitted.fit.rmse_m_s, rel=1e-2)


@pytest.mark.parametrize(
    "selection",
    [Selection(effects=("levitation",)), Selection().held("mass", 1.0), Selection(formulas=("nonsense",))],
    ids=["effect", "parameter", "formula"],
)
def test_what_is_not_known_is_refused(session, selection):
    with pytest.raises(InputError):
        views.show(session, selection, LIGHT)


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_has_a_figure(session, view):
    shown = views.show(session, Selection(view=view, effects=("leg_slip",), cell=3), LIGHT)
    assert "layout" in shown.figure
    assert "error" in shown.status
    assert "noise floor" in shown.status


def test_a_view_that_the_data_can_not_fill_says_why():
    session = Session(cells_of(made_up_trials(lift=False)), Inline())
    for selection in (Selection(view="lock"), Selection(view="residuals", observable="lift")):
        (said,) = views.show(session, selection, LIGHT).figure["layout"]["annotations"]
        assert "not measured" in said["text"]


def test_trials_of_a_cell_are_its_replicates(trials):
    cells = cells_of(trials)
    rows = waveforms.trials_of(trials, cells, 5)
    assert len(rows) == 2
    assert trials.omega_rad_s[rows] == pytest.approx(cells.omega[5])
    assert trials.phi[rows].mean() == pytest.approx(cells.phi[5])


def test_a_bag_that_is_not_there_is_said(tmp_path):
    found, missing = waveforms.read({"a": tmp_path / "a"}, ["a", "b"])
    assert found == []
    assert [line.split(":")[0] for line in missing] == ["a", "b"]
    assert waveforms.read({}, ["a"])[1] == ["These trials come from a table, not from bags: v_x(t) can't be shown."]


def test_the_page_shows_one_value_for_each_output(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.ahead = lambda selection: None
    values = dict(zip((f"{o.component_id}.{o.component_property}" for o in SHOW_OUTPUTS),
                      explorer.show(Selection(effects=("leg_slip",), cell=1), "dark"), strict=True))  # fmt: skip
    assert values["address.search"] == "?effect=leg_slip&cell=1"
    assert values["effects.value"] == ["leg_slip"]
    assert "leg slip" in values["status.children"]
    assert values["message.children"] == ""
    explorer.app()


def test_the_saved_file_carries_the_numbers_shown(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    selection = Selection(effects=("leg_slip",))
    saved = yaml.safe_load(explorer.saved(selection))
    assert saved["result"]["rmse_m_s"] == session.shown(selection).fit.rmse_m_s
    assert from_mapping(saved, "saved.yaml") == selection


def test_a_discovery_that_fails_says_so(session, trials, tmp_path, monkeypatch):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")

    def refuse(*_):
        raise InputError("no replicates")

    monkeypatch.setattr(session, "suggest", refuse)
    explorer.begin(Selection())
    limit = time.monotonic() + 5
    while explorer.job.running and time.monotonic() < limit:
        time.sleep(0.01)
    assert explorer.job.failed == "No suggestion: no replicates"


def test_a_limit_of_the_data_stands_on_the_page(tmp_path):
    trials = made_up_trials(phis=(0.633,))
    explorer = Explorer(Session(cells_of(trials), Inline()), trials, [tmp_path / "x.csv"], "one phi")
    assert "every trial is at φ = 0.633" in str(explorer.app().layout)


def test_a_second_data_set_is_shown_with_the_same_effects(session, trials, tmp_path):
    other = Session(cells_of(made_up_trials(phis=(0.61, 0.62))), Inline())
    other.ahead = session.ahead = lambda selection: None
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "first", Beside(other, "the other lab"))
    values = explorer.show(Selection(effects=("leg_slip",), cell=1), "light")
    beside = str(values[[o.component_id for o in SHOW_OUTPUTS].index("beside")])
    assert "the other lab" in beside
    assert "leg slip" in beside


def test_only_this_host_is_answered(session, trials, tmp_path):
    client = Explorer(session, trials, [tmp_path / "x.csv"], "test").app().server.test_client()
    assert client.get("/", headers={"Host": "127.0.0.1:8050"}).status_code == 200
    assert client.get("/", headers={"Host": "elsewhere.example"}).status_code == 403


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--port", "99999"], "--port 99999 is not between 0 and 65535"),
        (["--workers", "0"], "--workers 0: at least one is needed"),
        (["--selection", "absent.yaml"], "absent.yaml: no such file"),
        (["--beside", "absent.csv"], "absent.csv: no such file"),
    ],
)
def test_the_command_line_refuses_in_one_line(arguments, said, trials, tmp_path, capsys, monkeypatch):
    write_csv(trials, tmp_path / "trials.csv")
    monkeypatch.chdir(tmp_path)
    assert explore_tool.main(["trials.csv", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_port_in_use_is_said_in_one_line(trials, tmp_path, capsys):
    write_csv(trials, tmp_path / "trials.csv")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert explore_tool.main([str(tmp_path / "trials.csv"), "--port", port, "--workers", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--port {port}" in line


def test_bags_are_known_by_their_whole_name(tmp_path):
    bag = tmp_path / "trials" / "phi0.6000_w04.000_r01"
    bag.mkdir(parents=True)
    (bag / "metadata.yaml").touch()
    assert waveforms.bags_of([tmp_path]) == {"phi0.6000_w04.000_r01": bag}
