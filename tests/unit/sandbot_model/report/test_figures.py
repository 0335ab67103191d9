"""Figures say what the data say: values, units, marks; and nothing where nothing was measured."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import plotly.graph_objects as go
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.fitting import goodness
from sandbot_model.fitting.goodness import Fail
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.geometry import deepest_m, step_from_lift
from sandbot_model.physics.observables import Observable
from sandbot_model.report import balance, captions, figures, lock, mechanics, residual_map, table_sections
from sandbot_model.report.curves import broken, steps
from sandbot_model.report.theme import DARK, LIGHT
from sandbot_model.report.view import Step, bands, frequencies
from sandbot_record.trials.table import Row, from_rows

PHI = np.array([0.58, 0.60, 0.633])
OMEGA = np.array([4.0, 12.0, 20.0, 28.0])
NONE = np.full(len(PHI) * len(OMEGA) * 2, np.nan)


def made_up_cells(**columns):
    """Two replicates a cell, speed 10 cm/s ± 1 cm/s everywhere unless told otherwise."""
    phi, omega, replicate = (a.ravel() for a in np.meshgrid(PHI, OMEGA, [-1.0, 1.0], indexing="ij"))
    rows = [
        Row(phi=p, omega_rad_s=w, gait="UNIFORM", replicate=r) for p, w, r in zip(phi, omega, replicate, strict=True)
    ]
    return cells_of(dataclasses.replace(from_rows(rows), **{"speed_m_s": 0.10 + 0.01 * replicate} | columns))


def made_up_step(cells, z=None, fails=(), effects=()):
    grid = np.linspace(4, 28, 7)
    table = np.zeros((len(cells), 4)) if z is None else z
    fit = SimpleNamespace(
        cells=cells, effects=effects, model=SimpleNamespace(base="simple"), residual_z=table, fails=fails,
        lack_of_fit_p=0.5, errors_hold=True, rmse_m_s=0.02, cv_rmse_m_s=0.03,
        uncertainty=lambda phi, omega, beta: np.full((*np.broadcast_shapes(phi.shape, omega.shape), 4), 0.01),
    )  # fmt: skip
    return Step(fit, grid, np.full((len(bands(cells)), len(grid)), 0.10))


def traces(spec, kind):
    return [trace for trace in spec["data"] if kind in trace.get("mode", trace["type"])]


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
def test_every_figure_is_one_that_plotly_accepts(theme):
    cells = made_up_cells(lift_m=np.full(NONE.shape, 0.004))
    base, more = made_up_step(cells), made_up_step(cells, effects=("leg_slip",))
    specs = [
        figures.speed(more, base, theme),
        residual_map.residual_map(more, "speed", base, theme),
        figures.ladder((base, more), 0.01, 1, theme),
        lock.geometry_lock(cells, theme),
    ]
    for spec in specs:
        go.Figure(spec)


def test_speed_is_drawn_in_cm_per_s_with_the_replicates_scatter():
    spec = figures.speed(made_up_step(made_up_cells()))
    drawn = [trace for trace in traces(spec, "markers") if trace["x"] != [None]]
    assert len(drawn) == len(PHI)
    for trace in drawn:
        assert trace["x"] == OMEGA.tolist()
        assert trace["y"] == pytest.approx([10.0] * len(OMEGA))
        assert trace["error_y"]["array"] == pytest.approx([np.sqrt(2)] * len(OMEGA), rel=1e-5)
    assert spec["layout"]["yaxis"]["title"]["text"] == "speed (cm/s)"
    assert spec["layout"]["xaxis3"]["title"]["text"] == "ω (rad/s)"


def test_the_band_is_two_standard_errors_to_either_side_and_can_be_left_out():
    step = made_up_step(made_up_cells())
    areas = [trace for trace in figures.speed(step)["data"] if trace.get("fill") == "toself"]
    assert len(areas) == len(PHI)
    for area in areas:
        assert (min(area["y"]), max(area["y"])) == pytest.approx((8.0, 12.0))
        assert len(area["x"]) == len(area["y"]) == 2 * len(step.uncertainty.omega_rad_s)
    assert not [trace for trace in figures.speed(step, with_uncertainty=False)["data"] if "fill" in trace]


def test_a_band_is_neither_drawn_nor_named_where_errors_do_not_hold():
    step = made_up_step(made_up_cells())
    assert "± 2 standard errors of the model" in [trace["name"] for trace in figures.speed(step)["data"]]
    step.fit.errors_hold = False
    drawn = figures.speed(step)["data"]
    assert not [trace for trace in drawn if "fill" in trace or "standard errors" in trace["name"]]


def test_an_untested_model_is_not_said_to_fail_nowhere():
    step = made_up_step(made_up_cells())
    for p, said in ((0.5, "no cell fails"), (np.nan, "can't be tested")):
        step.fit.lack_of_fit_p = p
        assert said in residual_map.residual_map(step, "speed")["layout"]["annotations"][0]["text"]
        assert said in captions.residuals(step, "speed")


WALKING = np.array([True] * 5 + [False] * 3)


@pytest.mark.parametrize(
    ("walks_m_s", "drawn_m_s"),
    [
        # Slower than a swimmer before it swims: swimming is drawn, in one line.
        ([0.10, 0.08, 0.06, 0.01, 0.005], [0.10, 0.08, 0.06, 0.02, 0.02, 0.02, 0.02, 0.02]),
        # A jump from walking to swimming is a gap.
        ([0.10, 0.10, 0.10, 0.10, 0.10], [0.10, 0.10, 0.10, 0.10, 0.10, np.nan, 0.02, 0.02]),
    ],
)
def test_walking_slower_than_swimming_is_not_drawn_and_a_jump_breaks_the_line(walks_m_s, drawn_m_s):
    found = SimpleNamespace(walking=WALKING, speed_m_s=np.array([*walks_m_s, 0.02, 0.02, 0.02]))
    np.testing.assert_array_equal(broken(found, 0.02), drawn_m_s)


def test_a_band_goes_on_where_its_curve_has_a_gap():
    step = made_up_step(made_up_cells())
    gap = dataclasses.replace(step, speed_m_s=np.where(np.arange(7) == 3, np.nan, step.speed_m_s))
    (area, *_) = [trace for trace in figures.speed(gap)["data"] if "fill" in trace]
    assert None not in area["y"]
    assert None in figures.line(gap, 0, {})["y"]


def test_beside_a_switch_the_band_ends_where_the_curve_does():
    """Speed there is that of a walker or of a swimmer, never more and never less than nothing."""
    cells = made_up_cells()
    step = made_up_step(cells)
    walker = np.where(step.omega_rad_s < 16, 0.2, 0.02)
    unsure = np.where(np.arange(7) == 3, 0.15, 0.001)

    def uncertainty(phi, omega, _beta):
        at = np.searchsorted(step.omega_rad_s, omega)
        return np.broadcast_to(unsure[at][..., None], (*np.broadcast_shapes(phi.shape, omega.shape), 4))

    step = Step(SimpleNamespace(**{**vars(step.fit), "uncertainty": uncertainty}), step.omega_rad_s,
                np.broadcast_to(walker, step.speed_m_s.shape))  # fmt: skip
    area = step.uncertainty
    assert area.high_m_s.max() == pytest.approx(0.2 + 0.002)
    assert area.low_m_s.min() == pytest.approx(0.02 - 0.002)
    assert area.high_m_s[0, 0] - area.low_m_s[0, 0] == pytest.approx(0.004)


def test_the_base_model_is_a_ghost_only_beside_another_model():
    cells = made_up_cells()
    base, more = made_up_step(cells), made_up_step(cells, effects=("leg_slip",))

    def dashed(spec):
        return [trace for trace in spec["data"] if trace.get("line", {}).get("dash") == "dash" and trace["x"] != [None]]

    assert len(dashed(figures.speed(more, base))) == len(PHI)
    assert not dashed(figures.speed(base, base))


def test_failing_cells_are_marked_by_sign_and_number_not_by_colour_alone():
    cells = made_up_cells()
    z = np.zeros((len(cells), 4))
    up, down, quiet = 3, 8, 5
    z[up, 0], z[down, 0], z[quiet, 0] = 12.4, -5.6, 2.0
    fails = tuple(Fail("speed", cells.phi[i], cells.omega[i], 0.1, z[i, Observable.speed], i) for i in (up, down))
    *_, trace = residual_map.residual_map(made_up_step(cells, z, fails), "speed")["data"]
    text = np.array(trace["text"])
    assert text[cells.level[up], up % 4] == "▲ 12"
    assert text[cells.level[down], down % 4] == "▼ 6"
    assert (text != "").sum() == 2


def test_of_two_gaits_at_one_phi_and_omega_the_cell_that_fails_is_marked():
    phi, omega, gait = (a.ravel() for a in np.meshgrid(PHI, OMEGA, ["UNIFORM", "SGCS"], indexing="ij"))
    rows = [Row(f"t{i}", phi[i], omega_rad_s=omega[i], gait=gait[i], speed_m_s=0.1) for i in range(len(phi))]
    cells = cells_of(from_rows(rows))
    sgcs = next(i for i in range(len(cells)) if cells.gait[i] == "SGCS" and cells.omega[i] == OMEGA[1])
    uniform = next(i for i in range(len(cells)) if cells.gait[i] == "UNIFORM" and cells.omega[i] == OMEGA[2])
    z = np.zeros((len(cells), 4))
    z[[sgcs, uniform], 0] = 9.0, -5.0
    step = made_up_step(cells, z, goodness.fails(cells, z, z))
    assert np.flatnonzero(residual_map.failing_cells(step.fit, "speed")).tolist() == sorted([sgcs, uniform])
    *_, trace = residual_map.residual_map(step, "speed")["data"]
    text = np.array(trace["text"])
    assert text[trace["y"].index("φ 0.580 SGCS"), 1] == "▲ 9"
    assert text[trace["y"].index("φ 0.580 UNIFORM"), 2] == "▼ 5"
    assert (text != "").sum() == 2
    said = captions.residuals(step, "speed")
    assert "2 of 24 cells fail. Worst: φ 0.580 SGCS, ω" in said
    ((table,),) = (section.tables for section in table_sections.failing((step,)))
    assert [row[1] for row in table.rows] == ["0.580 SGCS", "0.580 UNIFORM"]


def test_each_map_of_two_models_has_its_models_name():
    cells = made_up_cells()
    base, more = made_up_step(cells), made_up_step(cells, effects=("leg_slip",))
    maps = traces(residual_map.residual_map(more, "speed", base), "heatmap")
    assert [one["name"] for one in maps] == [figures.model_name(base), figures.model_name(more)]


@given(st.sets(st.integers(0, len(PHI) * len(OMEGA) - 1)))
def test_a_map_has_its_rows_and_columns_in_order_whichever_cells_fail(failing):
    """The words stand on the map as a trace of their own, before it: left to itself Plotly would order by them."""
    cells = made_up_cells()
    fails = tuple(Fail("speed", cells.phi[i], cells.omega[i], 0.1, 9.0, i) for i in failing)
    step = made_up_step(cells, np.full((len(cells), 4), 9.0), fails)
    base = made_up_step(cells)
    spec = residual_map.residual_map(step, "speed", base)
    for key in ("", "2"):
        across, up = (spec["layout"][f"{letter}axis{key}"] for letter in "xy")
        assert (across["categoryorder"], up["categoryorder"]) == ("array", "array")
        assert across["categoryarray"] == ["4", "12", "20", "28"]
        assert up["categoryarray"] == ["φ 0.580", "φ 0.600", "φ 0.633"]
    assert len(spec["data"][2]["text"]) == len(failing)


def test_a_cell_that_was_not_measured_is_said_to_be_so():
    speed = np.full(NONE.shape, 0.1)
    lift = np.where(np.arange(len(NONE)) < 2, np.nan, 0.005)
    cells = made_up_cells(speed_m_s=speed, lift_m=lift)
    z = np.zeros((len(cells), 4))
    z[0, 1] = np.nan
    *_, trace = residual_map.residual_map(made_up_step(cells, z), "lift")["data"]
    assert trace["text"][0][0] == "–"
    assert trace["z"][0][0] is None
    assert trace["text"][0][1] == ""


def test_colour_saturates_but_the_true_residual_is_kept():
    cells = made_up_cells()
    z = np.zeros((len(cells), 4))
    z[0, 0] = 40.0
    *_, trace = residual_map.residual_map(made_up_step(cells, z), "speed")["data"]
    assert trace["z"][0][0] == residual_map.Z_COLOUR_END
    assert trace["customdata"][0][0] == [40.0, 0]


def test_frequencies_that_replicates_miss_a_little_are_one_column():
    rng = np.random.default_rng(1)
    phi, omega, _ = (a.ravel() for a in np.meshgrid(PHI, OMEGA, [0, 1], indexing="ij"))
    cells = made_up_cells(omega_rad_s=omega * (1 + 1e-3 * rng.uniform(-1, 1, omega.shape)), phi=phi)
    found, column = frequencies(cells)
    assert found == pytest.approx(OMEGA, rel=2e-3)
    assert column.tolist() == [0, 1, 2, 3] * 3


def test_gaits_are_bands_of_their_own():
    gaits = np.array(["SGCS", "HGCS"] * (len(NONE) // 2))
    cells = made_up_cells(gait=gaits)
    assert [band.label for band in bands(cells)][:2] == ["φ 0.580 HGCS", "φ 0.580 SGCS"]
    assert [band.label for band in bands(made_up_cells())] == ["φ 0.580", "φ 0.600", "φ 0.633"]


def test_the_ladder_shows_both_errors_and_the_floor_in_cm_per_s():
    step = made_up_step(made_up_cells())
    outside, inside, floor = figures.ladder((step, step), 0.005, 0)["data"]
    assert outside["y"] == pytest.approx([3.0, 3.0])
    assert inside["y"] == pytest.approx([2.0, 2.0])
    assert floor["y"] == pytest.approx([0.5, 0.5])


def test_without_replicates_the_ladder_has_no_floor():
    step = made_up_step(made_up_cells())
    assert len(figures.ladder((step,), np.nan, 0)["data"]) == 2


@pytest.mark.parametrize(("depth_m", "step_over_r"), [(0.03762, 1.290), (0.04426, 0.618)])
def test_lock_curve_has_the_reference_values(depth_m, step_over_r):
    """Physics §5: d and s/R at k = 200 and 170 N/m; lift is 2R − h − d."""
    lift = np.array([2 * 0.0355 - 0.025 - depth_m])
    assert step_from_lift(lift, 0.0355)[0] / 0.0355 == pytest.approx(step_over_r, abs=1e-3)


def test_points_of_a_locked_robot_lie_on_the_curve_and_others_do_not():
    lift = np.full(NONE.shape, 0.008)
    omega = np.meshgrid(PHI, OMEGA, [0, 1], indexing="ij")[1].ravel()
    locked = omega * step_from_lift(lift, 0.0355) / np.pi
    for share, on_curve in [(1.0, True), (0.85, False)]:
        spec = lock.geometry_lock(made_up_cells(lift_m=lift, speed_m_s=share * locked))
        points = np.concatenate([trace["y"] for trace in traces(spec, "markers")])
        assert np.allclose(points, 100 * step_from_lift(lift, 0.0355)[0], rtol=1e-6) == on_curve


def test_the_lock_curve_is_smooth_where_it_is_upright():
    """No chord of it turns by much from the one before."""
    curve = lock.geometry_lock(made_up_cells(lift_m=np.full(NONE.shape, 0.006)))["data"][0]
    x, y = (np.array(curve[key]) / curve[key][-1] for key in "xy")
    turns = np.abs(np.diff(np.unwrap(np.arctan2(np.diff(y), np.diff(x)))))
    assert turns.max() < np.radians(3)


@pytest.mark.parametrize("panels", [1, 4, 7])
@pytest.mark.parametrize("height", [190, 260])
def test_titles_of_panels_have_their_room_below_a_legend_of_any_height(panels, height):
    """A legend pushes the top of the paper down and no further: a title above it would stand in the legend."""
    shown = figures.grid_of_panels(["title"] * panels, LIGHT, 4, height)["layout"]
    paper = shown["height"] - shown["margin"]["t"] - shown["margin"]["b"]
    tops = [one["domain"][1] for name, one in shown.items() if name.startswith("yaxis")]
    assert (1 - max(tops)) * paper >= 1.3 * shown["annotations"][0]["font"]["size"]


@pytest.fixture
def fitted(drawn):
    """Steps of the simple model and of it with disturbed ground, on trials of the latter."""
    trials = drawn(("disturbed_ground",), omega=(4, 10, 16, 22, 28), levels=3)
    return steps(compare(cells_of(trials), catalogue(), ["disturbed_ground"]))


def test_forces_cross_where_the_leg_holds(fitted):
    """k d = m (g + Rω/Δt) for the simple model; a robot that swims has no crossing and the figure says so."""
    base, omega = fitted[0], 10.0
    spec = balance.force_balance(base, omega)
    robot, delta_t = base.fit.model.robot, base.fit.parameters["delta_t_s"].value
    needed = robot.mass_per_leg_kg * (robot.gravity_m_s2 + robot.leg_radius_m * omega / delta_t)
    dots = {one["xaxis"]: one for one in spec["data"] if one["name"] == "the leg holds" and "xaxis" in one}
    assert dots
    for i, k in enumerate(base.fit.k_n_per_m):
        axis = f"x{'' if i == 0 else i + 1}"
        (said,) = [one["text"] for one in spec["layout"]["annotations"] if one.get("xref") == f"{axis} domain"]
        depth = needed / k
        if depth < deepest_m(robot):
            assert dots[axis]["x"] == pytest.approx([100 * depth], rel=1e-4)
            assert dots[axis]["y"] == pytest.approx([needed], rel=1e-4)
            assert said == f"d = {100 * depth:.2f} cm"
        else:
            assert axis not in dots
            assert said == "never holds: swims"
    go.Figure(balance.force_balance(fitted[1], omega, base))


def test_the_modelled_critical_frequency_parts_walking_from_swimming(fitted):
    step = fitted[1]
    spec = mechanics.critical(step)
    go.Figure(spec)
    (line,) = [trace for trace in spec["data"] if trace["mode"] == "lines" and "xaxis" not in trace]
    points = [(phi, omega) for phi, omega in zip(line["x"], line["y"], strict=True) if omega is not None and omega > 1]
    assert points
    phi, omega = np.array(points).T
    assert step.fit.predict(phi, omega - 0.1).walking.all()
    assert not step.fit.predict(phi, omega + 0.1).walking.any()


def test_words_under_the_figures_tell_their_numbers(fitted):
    base = fitted[0]
    failing = residual_map.failing_cells(base.fit, "speed")
    assert failing.any()
    verb = "fails" if failing.sum() == 1 else "fail"
    assert f"{failing.sum()} of {len(failing)} cells {verb}" in captions.residuals(base, "speed")
    worst = np.nanargmax(np.abs(np.where(failing, base.fit.residual_z[:, Observable.speed], np.nan)))
    assert captions.condition_label(base.fit.cells, worst) in captions.residuals(base, "speed")
    assert "no cell fails" in captions.residuals(made_up_step(made_up_cells()), "speed")
    seen = mechanics.collapse(base.fit.cells)
    ends = f"between {seen.last_walking_rad_s[-1]:.3g} and {seen.first_swimming_rad_s[-1]:.3g} rad/s"
    assert ends in captions.critical(base)
    assert f"{100 * base.fit.rmse_m_s:.2f} cm/s in sample" in captions.ladder(fitted, 0.005)


@given(count=st.integers(1, 40))
def test_the_phi_palette_is_ordered_and_distinct(count):
    for theme in (LIGHT, DARK):
        colours = theme.phi_colours(count)
        assert len(set(colours)) == count


@given(panels=st.integers(1, 60), most=st.integers(1, 6))
def test_panels_fill_their_rows_evenly_and_stay_on_the_paper(panels, most):
    columns = figures._columns(panels, most)
    assert 1 <= columns <= most
    rows = -(-panels // columns)
    for i in range(panels):
        (left, right), (bottom, top) = figures._panel(i // columns, i % columns, rows, columns)
        assert -1e-9 <= left < right <= 1
        assert 0 <= bottom < top <= 1
