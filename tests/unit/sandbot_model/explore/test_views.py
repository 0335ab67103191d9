"""Every view has a figure and words for it, also on data that can't show everything."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
from inline import Inline
from made_up import EFFECTS, made_up_trials

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.selection import VIEWS, Selection
from sandbot_model.explore import cell_trials, views
from sandbot_model.explore.app import Explorer
from sandbot_model.explore.session import Session
from sandbot_model.physics.observables import NAMES, Observable
from sandbot_model.report import text
from sandbot_model.report.theme import LIGHT


def test_a_value_held_by_hand_is_what_the_figures_show(session):
    fitted = session.step(Selection())
    best = fitted.fit.parameters["delta_t_s"].value
    held = session.step(Selection().held("delta_t_s", 0.5 * best))
    assert held.fit.parameters["delta_t_s"].value == pytest.approx(0.5 * best)
    assert held.fit.rmse_m_s > fitted.fit.rmse_m_s
    assert np.isnan(held.fit.parameters["delta_t_s"].stderr)
    assert held.fit.parameters["v_swim_m_s"] == fitted.fit.parameters["v_swim_m_s"]  # nothing is refitted
    np.testing.assert_array_equal(held.fit.k_stderr_n_per_m, fitted.fit.k_stderr_n_per_m)
    with pytest.raises(InputError, match=r"delta_t_s=-1: at least 0\.02 is needed"):
        session.step(Selection().held("delta_t_s", -1.0))
    (slider, *_) = views.sliders(Selection().held("delta_t_s", 0.5 * best), held, EFFECTS)
    assert (slider.low, slider.high, slider.held) == (0.1, 1.2, True)
    same = session.step(Selection().held("delta_t_s", best))
    assert same.fit.rmse_m_s == pytest.approx(fitted.fit.rmse_m_s, rel=1e-2)


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_has_a_figure(session, view):
    shown = views.show(session, Selection(view=view, effects=("leg_slip",), cell=3), LIGHT)
    assert "layout" in shown.figure
    assert "error" in shown.status
    assert "noise floor" in shown.status


def test_a_view_that_the_data_can_not_fill_says_why():
    session = Session(cells_of(made_up_trials(columns=("speed_m_s", "peak_speed_m_s", "first_step_m"))), Inline())
    for selection in (Selection(view="lock"), Selection(view="residuals", observable="lift")):
        (said,) = views.show(session, selection, LIGHT).figure["layout"]["annotations"]
        assert "not measured" in said["text"]


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
            assert "nan" not in f"{shown.caption} {shown.status}"
    assert cell_trials.parts(trials, {}, session.step(Selection()).fit, 1, LIGHT)


def test_a_model_with_no_fewer_parameters_than_means_has_no_curve_and_no_error():
    """One trial: the curve through it was drawn with a band, and the error given in picometres."""
    one = made_up_trials(phis=(0.633,), replicates=1).select(np.arange(1))
    unknown = dict.fromkeys(("lift_m", "peak_speed_m_s", "first_step_m"), np.full(1, np.nan))
    session = Session(cells_of(replace(one, **unknown)), Inline())
    shown = views.show(session, Selection(), LIGHT)
    assert shown.status.startswith("simple model can't be tested: ")
    assert "can't determine" in shown.status
    assert not [trace for trace in shown.figure["data"] if trace.get("mode") == "lines"]
    assert "No model is drawn: " in shown.caption
    ladder = shown.ladder["layout"]
    assert (ladder["yaxis"]["range"], ladder["yaxis"]["exponentformat"], ladder["annotations"]) == (
        [0, 1.0],
        "none",
        [],
    )
    assert views.show(Session(cells_of(one), Inline()), Selection(), LIGHT).status.endswith(" 0 of 1 condition fails.")
    for view in views.OF_THE_MODEL:
        (said,) = views.show(session, Selection(view=view), LIGHT).figure["layout"]["annotations"]
        assert "can't determine" in said["text"]


def test_a_figure_is_told_in_words_with_its_numbers(session):
    shown = views.show(session, Selection(view="residuals"), LIGHT)
    fit = shown.current.fit
    failing = [fail for fail in fit.fails if fail.observable == "speed"]
    verb = "fails" if len(failing) == 1 else "fail"
    said = f"{len(failing)} of {len(fit.cells)} cells {verb}" if failing else "no cell fails"
    assert said in shown.caption
    fastest = 100 * np.nanmax(fit.cells.mean[:, Observable.speed])
    assert f"Fastest: {fastest:.2f} cm/s" in views.show(session, Selection(), LIGHT).caption
    for view in VIEWS:
        one = views.show(session, Selection(view=view), LIGHT)
        assert one.caption
        assert one.how_to_read
        assert "nan" not in one.caption


def test_values_held_by_hand_have_no_uncertainty(session):
    fitted = views.show(session, Selection(), LIGHT).figure
    held = views.show(session, Selection().held("delta_t_s", 0.3), LIGHT).figure
    assert any("fill" in trace for trace in fitted["data"])
    assert not any("fill" in trace for trace in held["data"])


def test_an_effect_that_is_on_shows_its_values(session):
    step = session.step(Selection(effects=("leg_slip",)))
    value, stderr = step.fit.parameters["leg_slip.sigma"]
    assert views.fitted_values(EFFECTS["leg_slip"], step.fit).endswith(f" {text.with_error(value, stderr)}")
    assert views.fitted_values(EFFECTS["disturbed_ground"], step.fit) == ""
