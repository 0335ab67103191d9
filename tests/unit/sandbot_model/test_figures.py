"""Figures say what the data say: values, units, marks; and nothing where nothing was measured."""

from types import SimpleNamespace

import numpy as np
import plotly.graph_objects as go
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.cells import cells_of
from sandbot_model.fit import Fail
from sandbot_model.report import figures
from sandbot_model.report.theme import DARK, LIGHT
from sandbot_model.report.view import Step, bands, frequencies

PHI = np.array([0.58, 0.60, 0.633])
OMEGA = np.array([4.0, 12.0, 20.0, 28.0])
NONE = np.full(len(PHI) * len(OMEGA) * 2, np.nan)


def made_up_cells(**columns):
    """Two replicates a cell, speed 10 cm/s ± 1 cm/s everywhere unless told otherwise."""
    phi, omega, replicate = (a.ravel() for a in np.meshgrid(PHI, OMEGA, [-1.0, 1.0], indexing="ij"))
    trials = {
        "phi": phi, "omega_rad_s": omega, "gait": ["UNIFORM"] * len(phi), "status": ["ok"] * len(phi),
        "speed_m_s": 0.10 + 0.01 * replicate, "lift_m": NONE, "peak_speed_m_s": NONE, "first_step_m": NONE,
    }  # fmt: skip
    return cells_of(SimpleNamespace(**trials | columns))


def made_up_step(cells, z=None, fails=(), effects=()):
    grid = np.linspace(4, 28, 7)
    table = np.zeros((len(cells), 4)) if z is None else z
    fit = SimpleNamespace(
        cells=cells, effects=effects, model="simple", residual_z=table, fails=fails, rmse_m_s=0.02, cv_rmse_m_s=0.03,
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
        figures.residual_map(more, "speed", base, theme),
        figures.ladder((base, more), 0.01, 1, theme),
        figures.geometry_lock(cells, theme),
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
    fails = tuple(Fail("speed", cells.phi[i], cells.omega[i], 0.1, z[i, 0]) for i in (up, down))
    (trace,) = figures.residual_map(made_up_step(cells, z, fails), "speed")["data"]
    text = np.array(trace["text"])
    assert text[cells.level[up], up % 4] == "▲ 12"
    assert text[cells.level[down], down % 4] == "▼ 6"
    assert (text != "").sum() == 2


def test_a_cell_that_was_not_measured_is_said_to_be_so():
    speed = np.full(NONE.shape, 0.1)
    lift = np.where(np.arange(len(NONE)) < 2, np.nan, 0.005)
    cells = made_up_cells(speed_m_s=speed, lift_m=lift)
    z = np.zeros((len(cells), 4))
    z[0, 1] = np.nan
    (trace,) = figures.residual_map(made_up_step(cells, z), "lift")["data"]
    assert trace["text"][0][0] == "–"
    assert trace["z"][0][0] is None
    assert trace["text"][0][1] == ""


def test_colour_saturates_but_the_true_residual_is_kept():
    cells = made_up_cells()
    z = np.zeros((len(cells), 4))
    z[0, 0] = 40.0
    (trace,) = figures.residual_map(made_up_step(cells, z), "speed")["data"]
    assert trace["z"][0][0] == figures.Z_COLOUR_END
    assert trace["customdata"][0][0] == [40.0, 0]


def test_frequencies_that_replicates_miss_a_little_are_one_column():
    rng = np.random.default_rng(1)
    phi, omega, _ = (a.ravel() for a in np.meshgrid(PHI, OMEGA, [0, 1], indexing="ij"))
    cells = made_up_cells(omega_rad_s=omega * (1 + 1e-3 * rng.uniform(-1, 1, omega.shape)), phi=phi)
    found, column = frequencies(cells)
    assert found == pytest.approx(OMEGA, rel=2e-3)
    assert column.tolist() == [0, 1, 2, 3] * 3


def test_gaits_are_bands_of_their_own():
    gaits = ["SGCS", "HGCS"] * (len(NONE) // 2)
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
    assert figures.lock_curve(lift)[0] / 0.0355 == pytest.approx(step_over_r, abs=1e-3)


def test_points_of_a_locked_robot_lie_on_the_curve_and_others_do_not():
    lift = np.full(NONE.shape, 0.008)
    omega = np.meshgrid(PHI, OMEGA, [0, 1], indexing="ij")[1].ravel()
    locked = omega * figures.lock_curve(lift) / np.pi
    for share, on_curve in [(1.0, True), (0.85, False)]:
        spec = figures.geometry_lock(made_up_cells(lift_m=lift, speed_m_s=share * locked))
        points = np.concatenate([trace["y"] for trace in traces(spec, "markers")])
        assert np.allclose(points, 100 * figures.lock_curve(lift)[0], rtol=1e-6) == on_curve


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
