"""The explorer without a browser: the selection survives its address and its file, fits are those of ``compare``."""

import json
import shlex
import socket
import time
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.serialization import to_cdr
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.choice import VIEWS, Selection, from_mapping, from_query, to_query, to_yaml
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.discover import discover
from sandbot_model.explore import app, behind, nothing, views, waveforms
from sandbot_model.explore.actions import act, adopted, clicked_cell, moved, used, values_of
from sandbot_model.explore.app import SHOWN, Beside, Explorer
from sandbot_model.explore.session import Session
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import COLUMNS, NAMES, Observable
from sandbot_model.physics.walking import Inputs
from sandbot_model.report import text, write_comparison
from sandbot_model.report.provenance import bags_of
from sandbot_model.report.theme import LIGHT
from sandbot_model.tools import compare as compare_tool
from sandbot_model.tools import explore as explore_tool
from sandbot_record.bags.writer import BagWriter
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.read import read
from sandbot_record.trials.table import Row, from_rows

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
    if not lift:
        values[:, Observable.lift] = np.nan
    return from_rows(
        [
            Row(
                trial_id=f"t{i:02d}",
                phi=float(phi[i] + rng.normal(0, 2e-4)),
                omega_rad_s=float(omega[i]),
                gait="UNIFORM",
                replicate=float(replicate[i]),
                **dict(zip(COLUMNS, values[i].tolist(), strict=True)),
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
    observable=st.sampled_from(NAMES),
    cell=st.none() | st.integers(0, 500),
    against=st.just("") | names.map(lambda name: Selection(effects=(name,)).pin().against),
)


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
    assert act(start, "unheard of", 1) == start


def test_what_discovery_found_is_switched_on(session, drawn):
    start = Selection(effects=("leg_slip",), by_hand=(("delta_t_s", 0.3),))
    hidden = "hidden: speed: kept, peak_ratio *= 1 - a*where(omega > 14, 1, 0); a [1] in 0.1..0.3"
    found = discover(cells_of(drawn(levels=3, formulas=[hidden])), {}, max_effects=0)
    named = replace(found, verdict=replace(found.verdict, effects=("cable_drag",)))
    assert adopted(start, named) == Selection(effects=("cable_drag",))
    # Nothing of the catalogue fits: what is left is added as a formula, on top of what it was fitted with.
    assert found.verdict.effects == ()
    assert found.residual is not None
    left = adopted(start, replace(found, residual=replace(found.residual, effects=("dilation",))))
    assert left.effects == ("dilation", "residual")
    assert left.formulas == (found.residual.formula,)
    assert "residual" in session.catalogue(left.formulas)
    assert adopted(start, replace(found, residual=None)) == Selection()


def test_a_control_used_adds_to_what_was_asked_for_and_is_not_shown_yet():
    shown = Selection(effects=("leg_slip", "cable_drag"))
    asked = replace(shown.toggled(["cable_drag", "dilation"]), view="lock", by_hand=(("delta_t_s", 0.3),))
    assert used(asked, shown, values_of(shown)) == asked
    both = used(asked, shown, values_of(replace(shown, cell=2).toggled(["leg_slip", "cable_drag", "cohesion"])))
    assert both == replace(asked, effects=("cable_drag", "dilation", "cohesion"), cell=2)
    assert used(asked, shown, values_of(shown.toggled(["leg_slip"]))).effects == ("dilation",)
    assert used(shown, shown, values_of(asked)) == replace(asked, by_hand=())
    assert used(asked, asked, values_of(replace(asked, model="full"))).by_hand == ()


def test_a_model_set_beside_stays_while_the_other_changes():
    pinned = act(Selection(effects=("leg_slip",), view="lock"), "pin", 1)
    changed = act(act(pinned, "effects", []), "model", "full")
    assert changed.other == Selection(effects=("leg_slip",), view="lock")
    assert act(changed, "unpin", 1).other is None
    assert Selection().other is None
    assert Selection().pin().other == Selection()


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


class Busy(Executor):
    """Workers that say they are at it and never come to an end."""

    def submit(self, function, /, *arguments, **named):
        future = Future()
        future.set_running_or_notify_cancel()
        return future


def test_a_worker_that_does_not_come_to_an_end_is_not_waited_for(trials):
    session = Session(cells_of(trials), Busy())
    assert session.ladder(Selection(effects=("leg_slip",)))[-1].fit.effects == ("leg_slip",)


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


PACE = 8.0


def walking_bag(path, *, v_x, legs=True, mount=0.0):
    """A second of ``v_x(t)`` at 100 Hz after 0.2 s at rest; the LED goes on as legs start from −π/2 at ``PACE``."""
    start = 1_700_000_000_200_000_000
    with BagWriter(path) as writer:
        writer.write(topics.SYNC_LED, to_cdr(messages.header(start, "sync_led")), start)
        if mount:
            writer.write(topics.TRIAL, to_cdr(messages.string(json.dumps({"leg_mount_rad": mount}))), start)
        for i in range(-20, 100):
            t_ns, t = start + i * 10_000_000, i / 100
            writer.write(topics.SPEED, to_cdr(messages.twist(t_ns, v_x(t), 0.0, 1e-4, 1e-4)), t_ns)
            if legs:
                turned, rate = PACE * max(t, 0.0), PACE * (t >= 0)
                angles = -np.pi / 2 + turned - np.repeat([0.0, np.pi], 3) - mount
                state = messages.joint_state(t_ns, topics.LEGS, angles, np.full(6, rate), np.zeros(6))
                writer.write(topics.LEG_STATES, to_cdr(state), t_ns)
    return path


def test_time_of_a_waveform_runs_from_the_start_of_the_legs(tmp_path):
    bag = walking_bag(tmp_path / "t00", v_x=lambda t: 0.1 * (t >= 0))
    (found,), missing = waveforms.read({"t00": bag}, ["t00"])
    assert missing == []
    assert found.time_s[[0, -1]] == pytest.approx([-0.2, 0.99])
    assert np.array_equal(found.speed_m_s > 0.05, found.time_s >= -1e-9)


def test_shaft_angles_become_those_of_the_legs(tmp_path):
    for name, mount in (("a", 0.0), ("b", 0.5)):
        walking_bag(tmp_path / name, v_x=lambda t: 0.0, mount=mount)
    (plain, mounted), _ = waveforms.read({name: tmp_path / name for name in "ab"}, ["a", "b"])
    assert mounted.leg_angle_rad == pytest.approx(plain.leg_angle_rad)


def test_the_modelled_waveform_is_the_arc_of_a_leg_that_holds(tmp_path, session):
    """v_x = Rω cos θ while |sin θ| ≤ s/2R, else 0: two stances a turn, of the step length the model predicts."""
    fit = session.shown(Selection()).fit
    (cell,) = np.flatnonzero((fit.cells.level == 2) & (fit.cells.omega == 4))
    bag = walking_bag(tmp_path / "t00", v_x=lambda t: 0.0)
    (found,), _ = waveforms.read({"t00": bag}, ["t00"])
    speed = waveforms.modelled(found, fit, cell)
    radius = fit.model.robot.leg_radius_m
    holds = speed > 0
    angle = np.arcsin(np.sin(found.leg_angle_rad[:, 0]))
    assert speed[holds] == pytest.approx(radius * PACE * np.cos(angle[holds]))
    step = fit.predict(fit.cells.level_phi[2], fit.cells.omega[cell]).step_m
    assert np.array_equal(holds, (np.abs(np.sin(angle)) <= step / 2 / radius) & (found.leg_time_s >= 0))
    spec = waveforms.figure([found], fit, cell, LIGHT)
    assert [trace["name"] for trace in spec["data"]] == ["model", "t00"]
    assert max(spec["data"][0]["y"]) == pytest.approx(100 * radius * PACE, rel=0.01)
    assert "v<sub>x</sub> (cm/s)" in spec["layout"]["yaxis"]["title"]["text"]


def test_without_leg_states_there_is_no_modelled_waveform(tmp_path, session):
    bag = walking_bag(tmp_path / "t00", v_x=lambda t: 0.1, legs=False)
    (found,), _ = waveforms.read({"t00": bag}, ["t00"])
    spec = waveforms.figure([found], session.shown(Selection()).fit, 0, LIGHT)
    assert [trace["name"] for trace in spec["data"]] == ["t00"]


def test_a_cell_shows_its_trials_waveforms_and_recordings(session, trials, tmp_path):
    cell = 5
    name = str(trials.trial_id[waveforms.trials_of(trials, session.cells, cell)[0]])
    bag = walking_bag(tmp_path / name, v_x=lambda t: 0.1)
    explorer = Explorer(session, trials, [bag], "test")
    shown = str(behind.parts(trials, explorer.bags, session.shown(Selection()).fit, cell, LIGHT))
    assert "waveforms" in shown
    assert "No video: the camera frames of these trials were not kept." in shown
    assert "no bag of that name" in shown
    client = explorer.app().server.test_client()
    answer = client.get(f"/bag/{name}/{name}_0.mcap", headers={"Host": "127.0.0.1:1"})
    assert answer.data == (bag / f"{name}_0.mcap").read_bytes()
    for other in (f"/bag/{name}/metadata.yaml", "/bag/absent/absent_0.mcap"):
        assert client.get(other, headers={"Host": "127.0.0.1:1"}).status_code == 404
    (tmp_path / "other.mcap").write_bytes(b"not shown")
    assert b"not shown" not in client.get(f"/bag/{name}/..%2Fother.mcap", headers={"Host": "127.0.0.1:1"}).data


def test_a_torn_bag_is_said_on_the_page(session, trials, tmp_path):
    bag = walking_bag(tmp_path / "torn", v_x=lambda t: 0.1)
    recording = bag / "torn_0.mcap"
    recording.write_bytes(recording.read_bytes()[:-200])
    explorer = Explorer(session, trials, [bag], "test")
    ((name, why),) = explorer.known.excluded
    assert name == "torn"
    assert "recover" in why
    assert "1 trials excluded, and why" in str(explorer.app().layout)
    fits = [session.shown(Selection()).fit]
    write_comparison(tmp_path / "report.html", fits, trials, title="torn", data=[bag])
    assert "1 excluded" in (tmp_path / "report.html").read_text(encoding="utf-8")
    found, (line,) = waveforms.read(explorer.bags, ["torn"])
    assert found == []
    assert "recover" in line


def test_a_bag_that_is_not_there_is_said(tmp_path):
    found, missing = waveforms.read({"a": tmp_path / "a"}, ["a", "b"])
    assert found == []
    assert [line.split(":")[0] for line in missing] == ["a", "b"]
    assert waveforms.read({}, ["a"])[1] == [
        "These trials come from a table, not from bags: v_x(t) and video can't be shown."
    ]


def test_the_page_shows_one_value_for_each_output(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.ahead = lambda selection: None
    values = explorer.show(Selection(effects=("leg_slip",), cell=1), "dark")
    assert set(values) == set(SHOWN)
    assert "leg slip" in values["status.children"]
    assert values["message.children"] == ""
    explorer.app()


def test_an_address_sets_the_controls_that_stand_elsewhere(session, trials, tmp_path, monkeypatch):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.ahead = lambda selection: None
    made = {}
    monkeypatch.setattr(app, "set_props", made.__setitem__)
    explorer.on_address("?effect=leg_slip&cell=1", "dark", values_of(Selection()))
    assert made == {
        "effects": {"value": ["leg_slip"]},
        "cell": {"value": 1},
        "shown": {"data": "?effect=leg_slip&cell=1"},
    }


def test_the_saved_file_carries_the_numbers_shown(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    selection = Selection(effects=("leg_slip",))
    saved = yaml.safe_load(explorer.saved(selection))
    assert saved["result"]["rmse_m_s"] == pytest.approx(session.shown(selection).fit.rmse_m_s, rel=1e-3)
    assert from_mapping(saved, "saved.yaml") == selection


@pytest.mark.parametrize(
    "selection",
    [
        Selection("full", ("leg_slip",)),
        Selection(effects=("leg_slip", "boost"), formulas=(BOOST,)).held("delta_t_s", 0.3),
    ],
    ids=["effects", "formula and a held value"],
)
def test_compare_gives_the_very_numbers_that_were_saved(session, trials, tmp_path, capsys, selection):
    """By the file, and by the command line that stands in it."""
    write_csv(trials, tmp_path / "trials.csv")
    again = cells_of(read(tmp_path / "trials.csv"))
    saved = Explorer(Session(again, Inline()), trials, [tmp_path / "trials.csv"], "test").saved(selection)
    (tmp_path / "explorer.yaml").write_text(saved, encoding="utf-8")
    content = yaml.safe_load(saved)
    commands = (
        [str(tmp_path / "trials.csv"), "--selection", str(tmp_path / "explorer.yaml")],
        shlex.split(content["command"])[1:],
    )
    for arguments in commands:
        assert compare_tool.main([*arguments, "--json", str(tmp_path / "out.json")]) == 0
        last = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["steps"][-1]
        for name in ("rmse_m_s", "cv_rmse_m_s"):
            assert last[name] == pytest.approx(content["result"][name], rel=1e-9)
    assert ("held by hand" in capsys.readouterr().out) == bool(selection.by_hand)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--hold", "delta_t_s"], "--hold 'delta_t_s': a finite number is needed"),
        (["--hold", "mass=1"], "parameter 'mass' is not one of delta_t_s"),
        (["--hold", "delta_t_s=0.3", "--bootstrap", "2"], "has no standard error"),
        (["--selection", "explorer.yaml", "--model", "full"], "leave out the options that say them too"),
        (["--selection", "trials.csv"], "trials.csv"),
    ],
)
def test_compare_refuses_a_state_that_makes_no_sense_in_one_line(
    arguments, said, trials, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    write_csv(trials, tmp_path / "trials.csv")
    (tmp_path / "explorer.yaml").write_text(to_yaml(Selection(), ["trials.csv"], {}), encoding="utf-8")
    assert compare_tool.main(["trials.csv", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


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


def thin(kind):
    """Trials that can't show everything."""
    whole = made_up_trials(replicates=1 if kind == "one replicate" else 2)
    if kind == "one φ":
        whole = made_up_trials(phis=(0.633,))
    if kind == "NaN rows":
        speed = np.where(np.arange(len(whole)) % 3 == 0, np.nan, whole.speed_m_s)
        lift = np.where(np.arange(len(whole)) % 4 == 0, np.nan, whole.lift_m)
        return replace(whole, speed_m_s=speed, lift_m=lift)
    if kind == "speed only":
        nothing = np.full(len(whole), np.nan)
        return replace(whole, lift_m=nothing, peak_speed_m_s=nothing, first_step_m=nothing)
    return whole


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("one φ", "every trial is at φ = 0.633"),
        ("one replicate", "no condition was repeated"),
        ("NaN rows", "8 trials excluded, and why"),
        ("speed only", "without lift there is no geometry lock"),
        ("whole", None),
    ],
)
def test_every_view_opens_on_thin_data_and_the_page_says_what_it_can_not_show(tmp_path, kind, said):
    trials = thin(kind)
    session = Session(cells_of(trials), Inline())
    explorer = Explorer(session, trials, [tmp_path / "x.csv"], kind)
    page = str(explorer.app().layout)
    assert said in page if said else "Can’t be shown" not in page
    for view in VIEWS:
        for observable in NAMES if view == "residuals" else ("speed",):
            shown = views.show(session, Selection(view=view, observable=observable, cell=1), LIGHT)
            go.Figure(shown.figure)
            go.Figure(shown.ladder)
            assert "nan" not in f"{shown.says} {shown.status}"
    assert behind.parts(trials, {}, session.shown(Selection()).fit, 1, LIGHT)


def test_data_that_show_nothing_get_a_page_that_says_why():
    page = nothing.app("<lab>", "trials.csv: no trials: nothing below the header").test_client()
    answer = page.get("/", headers={"Host": "127.0.0.1:8050"})
    assert answer.status_code == 200
    assert "nothing below the header" in answer.text
    assert 'role="alert"' in answer.text
    assert "&lt;lab&gt;" in answer.text
    assert page.get("/", headers={"Host": "elsewhere.example"}).status_code == 403


def test_a_second_data_set_is_shown_with_the_same_effects(session, trials, tmp_path):
    other = Session(cells_of(made_up_trials(phis=(0.61, 0.62))), Inline())
    other.ahead = session.ahead = lambda selection: None
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "first", Beside(other, "the other lab"))
    values = explorer.show(Selection(effects=("leg_slip",), cell=1), "light")
    beside = str(values["beside.children"])
    assert "the other lab" in beside
    assert "leg slip" in beside


def shown_by(explorer, selection):
    return explorer.show(selection, "light")


def test_two_models_stand_side_by_side_on_axes_that_end_alike(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "lab")
    session.ahead = lambda selection: None
    alone = shown_by(explorer, Selection())
    assert (alone["beside.children"], alone["pane-title.hidden"], alone["unpin.hidden"]) == ([], True, True)
    both = shown_by(explorer, Selection(effects=("leg_slip",)).pin().toggled(["stance_overlap"]))
    assert (both["pane-title.children"], both["pane-title.hidden"]) == ("lab: + stance overlap", False)
    (pane,) = both["beside.children"]
    title, body = pane.children
    assert title.children == "lab: + leg slip, set beside"
    other = body.children[0].children.figure
    assert other["layout"]["yaxis"]["range"] == both["figure.figure"]["layout"]["yaxis"]["range"]
    assert not both["unpin.hidden"]


def test_a_figure_is_told_in_words_with_its_numbers(session):
    shown = views.show(session, Selection(view="residuals"), LIGHT)
    fit = shown.current.fit
    failing = [fail for fail in fit.fails if fail.observable == "speed"]
    said = f"{len(failing)} of {len(fit.cells)} cells fail" if failing else "no cell fails"
    assert said in shown.says
    fastest = 100 * np.nanmax(fit.cells.mean[:, Observable.speed])
    assert f"Fastest: {fastest:.2f} cm/s" in views.show(session, Selection(), LIGHT).says
    for view in VIEWS:
        one = views.show(session, Selection(view=view), LIGHT)
        assert one.says
        assert one.how
        assert "nan" not in one.says


def test_values_held_by_hand_have_no_band(session):
    fitted = views.show(session, Selection(), LIGHT).figure
    held = views.show(session, Selection().held("delta_t_s", 0.3), LIGHT).figure
    assert any("fill" in trace for trace in fitted["data"])
    assert not any("fill" in trace for trace in held["data"])


def test_an_effect_that_is_on_shows_its_values_and_what_it_brings(session):
    step = session.shown(Selection(effects=("leg_slip",)))
    value, stderr = step.fit.parameters["leg_slip.sigma"]
    assert views.values(EFFECTS["leg_slip"], step).endswith(f" {text.with_error(value, stderr)}")
    assert views.values(EFFECTS["disturbed_ground"], step) == ""
    assert views.promise((0.01, 0.02), False, 0.03) == "on: 1.00 cm/s ▼ 2.00"
    assert views.promise((0.03, 0.02), True, 0.01) == "off: 3.00 cm/s ▲ 2.00"
    assert views.promise((0.01, 0.02), False, 0.01) == "on: 1.00 cm/s"
    assert views.promise(None, False, 0.01) == "…"
    assert views.promise((np.nan, np.nan), False, 0.01) == "no fit"


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
    assert bags_of([tmp_path]) == {"phi0.6000_w04.000_r01": bag}
