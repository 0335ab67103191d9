"""Figures saved as CSV, by the pages' own script in a real browser: each row says whose it is and in what unit."""

import csv

import pytest
from explorer_page import HIDDEN

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.report import balance, figures, lock, mechanics, profiles, residual_map
from sandbot_model.report.curves import steps
from sandbot_model.report.page import source
from sandbot_model.report.theme import LIGHT, axis, layout
from sandbot_model.report.view import bands

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(600)]

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
HEAD = ["panel", "series", "x name", "x", "y name", "y", "error"]


@pytest.fixture(scope="module")
def shown(trials):
    return steps(compare(cells_of(trials), EFFECTS, [HIDDEN]))


@pytest.fixture
def saved(page):
    """Rows of the CSV of a figure."""

    def rows(figure):
        text = page.driver.execute_script(
            f"{source('export.js')}; return window.sandbotExport.csv(arguments[0])", figure
        )
        head, *found = csv.reader(text.splitlines())
        assert head == HEAD
        return [dict(zip(HEAD, row, strict=True)) for row in found]

    return rows


def axes(rows):
    return {(row["panel"], row["x name"], row["y name"]) for row in rows}


def test_two_panels_of_different_units_keep_their_own(saved, shown):
    rows = saved(mechanics.critical(shown[-1]))
    frequency, speed = "critical frequency ωc (rad/s)", "largest mean speed (cm/s)"
    assert axes(rows) == {(frequency, "φ", frequency), (speed, "φ", speed)}
    peaks = [float(row["y"]) for row in rows if row["series"] == "largest mean speed, measured"]
    assert peaks == pytest.approx(100 * mechanics.collapse(shown[-1].fit.cells).peak_speed_m_s, rel=1e-4)
    assert {row["y name"] for row in rows if row["series"] == "largest mean speed, measured"} == {speed}


def test_inner_panels_have_the_titles_of_the_outer_ones_and_each_its_own_name(saved, shown):
    labels = {band.label for band in bands(shown[-1].fit.cells)}
    rows = saved(figures.speed(shown[-1], shown[0]))
    assert axes(rows) == {(label, "ω (rad/s)", "speed (cm/s)") for label in labels}
    rows = saved(balance.force_balance(shown[-1], 12.0))
    assert axes(rows) == {(label, "depth (cm)", "force on a leg (N)") for label in labels}


def test_each_parameter_of_the_profiles_has_its_own_name_and_unit(saved, shown):
    rows = saved(profiles.profiles(shown[-1], LIGHT))
    seen = axes(rows)
    assert len(seen) == len(shown[-1].fit.model.names)
    assert len({across for _, across, _ in seen}) == len(seen)
    assert any(across.endswith("(s)") for _, across, _ in seen)
    assert {up for *_, up in seen} == {"rise of the deviance"}


def test_panels_one_above_the_other_on_one_time_axis_keep_their_units(saved):
    """As those of a trial's records."""
    line = {"type": "scatter", "mode": "lines", "x": [0.0, 1.0]}
    data = [
        line | {"name": "measured", "y": [1.0, None], "yaxis": "y"},
        line | {"name": "tripod A", "y": [0.0, 90.0], "yaxis": "y2"},
    ]
    ups = {"yaxis": axis(LIGHT, "v<sub>x</sub> (cm/s)"), "yaxis2": axis(LIGHT, "leg angle (°)")}
    rows = saved({"data": data, "layout": layout(LIGHT, 300, xaxis=axis(LIGHT, "time (s)"), **ups)})
    assert [(row["series"], row["x name"], row["x"], row["y name"], row["y"]) for row in rows] == [
        ("measured", "time (s)", "0", "vx (cm/s)", "1"),
        ("tripod A", "time (s)", "0", "leg angle (°)", "0"),
        ("tripod A", "time (s)", "1", "leg angle (°)", "90"),
    ]


def test_maps_of_two_models_side_by_side_are_told_apart(saved, shown):
    cells = shown[-1].fit.cells
    rows = saved(residual_map.residual_map(shown[-1], "speed", shown[0]))
    unit = "measured − model (standard errors)"
    assert axes(rows) == {(figures.model_name(step), "ω (rad/s)", unit) for step in shown}
    assert len({(row["panel"], row["series"], row["x"]) for row in rows}) == len(rows) == 2 * len(cells)
    at = residual_map.map_cells(cells)
    for step in shown:
        own = [row for row in rows if row["panel"] == figures.model_name(step)]
        meant = [step.fit.residual_z[at[row["x"], row["series"]], 0] for row in own]
        assert [float(row["y"]) for row in own] == pytest.approx(meant, rel=1e-3, abs=1e-3)


def test_the_only_panel_of_a_figure_has_no_name(saved, shown):
    rows = saved(lock.geometry_lock(shown[-1].fit.cells))
    assert axes(rows) == {("", "body lift Δz (cm)", "step length πv̄/ω (cm)")}
    assert any(row["error"] for row in rows if row["series"].startswith("φ"))
