"""The atlas: every plate from a table, two more from bags, captions that say what is so."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_common.parallel import Processes
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.gait import GAITS
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs, Prediction, Walker
from sandbot_model.report.atlas import collapse, collect, force, leg, motion, speeds, style
from sandbot_model.report.atlas.material import Material, Motion, Published
from sandbot_model.report.atlas.plates import CAPTIONS, PLATES, write
from sandbot_model.report.mechanics import Collapse
from sandbot_model.tools import atlas
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.table import Row, from_rows

K = {0.59: 180.0, 0.61: 200.0, 0.63: 215.0}
OMEGA = (4.0, 12.0, 20.0, 30.0)
WITH_BAGS = {"1c", "1d"}


def table():
    """What the simple model does on three grounds, with a millimetre a second of scatter."""
    rng, rows = np.random.default_rng(3), []
    for phi, k in K.items():
        found = Walker().predict(Inputs(k, np.array(OMEGA), 0.4, phi))
        for number, omega in enumerate(OMEGA):
            for replicate in range(2):
                seen = found.observables[number] + rng.normal(0, [1e-3, 1e-4, 1e-3, 1e-4])
                name = f"{phi}_{omega:g}_{replicate}"
                rows.append(Row(name, phi, 0.0003, omega, "UNIFORM", replicate, seen[0], 0.001, *seen[1:]))
    return from_rows(rows)


@pytest.fixture(scope="module")
def material():
    trials = table()
    cells = cells_of(trials)
    simple, full = (fit(model_of(base, (), catalogue()), cells) for base in ("simple", "full"))
    return Material(trials, cells, (simple,), simple, full)


def test_a_plate_that_cannot_be_written_is_an_error_not_a_caption(material, tmp_path):
    with pytest.raises(InputError, match="fig1e_speed_phi"):
        next(write(tmp_path / "gone", material, formats=("svg",)))


def waveform(phi, speed):
    t = np.linspace(0, 2, 401)
    return Motion(f"phi{phi}", phi, 8.0, GAITS["UNIFORM"], t, np.full(t.shape, speed), t, 8.0 * t - np.pi / 2)


def with_motions(material):
    return Material(**{**vars(material), "motions": (waveform(0.63, 0.2), waveform(0.59, 0.02))})


def test_every_plate_of_a_table(material, tmp_path):
    said = dict(write(tmp_path, material, formats=("svg",)))
    assert [plate.number for plate in said] == [plate.number for plate in PLATES]
    without = {plate.number for plate, caption in said.items() if caption.startswith("not drawn: ")}
    assert without == WITH_BAGS
    drawn = {plate.stem for plate in PLATES if plate.number not in WITH_BAGS}
    assert {path.stem for path in tmp_path.glob("*.svg")} == drawn
    captions = json.loads((tmp_path / CAPTIONS).read_text())
    assert set(captions) == drawn
    for plate in PLATES:
        if plate.stem in drawn:
            width = re.search(r'width="([\d.]+)pt"', (tmp_path / f"{plate.stem}.svg").read_text())[1]
            assert float(width) == pytest.approx(plate.width_mm / 25.4 * 72, abs=0.5)


@pytest.mark.slow
def test_no_plate_shows_a_model_that_the_data_do_not_determine(tmp_path):
    """Two cell means: once Δt = 0.21 s was printed of them."""
    trials = from_rows([Row(f"{n}", phi, omega_rad_s=omega, speed_m_s=speed) for n, (phi, omega, speed) in enumerate(
        [(0.633, 16.0, 0.203), (0.633, 16.0, 0.198), (0.6, 12.0, 0.11)])])  # fmt: skip
    thin = collect.collect(trials, [fit(model_of("simple", (), catalogue()), cells_of(trials))], {})
    said = {plate.number: caption for plate, caption in write(tmp_path, thin, formats=("svg",))}
    of_data = {"3b", "3d"}
    assert {path.stem[3:5] for path in tmp_path.glob("*.svg")} == of_data
    assert all(
        "not drawn: 2 cell means can't determine 4 parameters" in said[n] for n in said.keys() - of_data - WITH_BAGS
    )


def test_where_only_the_papers_fit_is_not_determined_its_dashes_are_left_out(material, tmp_path):
    few = cells_of(from_rows([Row("a", 0.6, omega_rad_s=8.0, speed_m_s=0.1)]))
    thin = Material(**{**vars(material), "simple": fit(model_of("simple", (), catalogue()), few)})
    said = {plate.number: caption for plate, caption in write(tmp_path, thin, formats=("svg",))}
    assert "grey dashes" not in said["2a"]
    assert "not drawn" not in said["2a"]
    assert "not drawn" in said["4b"]


def test_two_processes_draw_what_one_draws(material, tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    with Processes(2).map() as draw_all:
        shared = dict(write(tmp_path / "two", material, formats=("svg",), draw_all=draw_all))
    assert shared == dict(write(tmp_path / "one", material, formats=("svg",)))
    one, two = (sorted((tmp_path / name).iterdir()) for name in ("one", "two"))
    assert [path.name for path in one] == [path.name for path in two]
    assert len(one) == len(PLATES) - len(WITH_BAGS) + 1


@pytest.mark.slow
def test_bags_give_the_motion_too(material, tmp_path):
    said = {plate.number: caption for plate, caption in write(tmp_path, with_motions(material), 85.0, ("svg",))}
    assert not any("not drawn" in caption for caption in said.values())
    assert "differ by 0.000 rad" in said["1c"]
    assert "20.0 cm/s" in said["1d"]
    assert "2.0 cm/s" in said["1d"]


def test_captions_follow_the_data(material, tmp_path):
    """Control: other trials, other words."""
    mean = {cell: 100 * speed for cell, speed in enumerate(material.cells.mean[:, 0])}
    _, caption = speeds.against_omega(material, 85.0)
    assert f"from {max(mean[i] for i in range(4)):.1f} cm/s at φ 0.590" in caption
    slower = Material(**{**vars(material), "cells": cells_of(table().select(table().omega_rad_s < 15))})
    assert speeds.against_omega(slower, 85.0)[1] != caption


def test_the_line_does_not_dip_below_swimming_and_the_switch_is_drawn():
    _, (panel,) = style.sheet(85.0, 60.0)
    walking = np.array([True, True, True, False, False])
    speed = np.array([0.10, 0.05, 0.001, 0.02, 0.02])
    nothing = np.zeros(5)
    found = Prediction(speed, nothing, nothing, nothing, nothing, nothing, walking)
    style.speed_line(panel, np.arange(5.0), found, 0.02, color="k")
    pieces = [line.get_ydata() for line in panel.lines]
    assert min(piece.min() for piece in pieces) == pytest.approx(2.0)
    assert sum(len(piece) for piece in pieces[:2]) == 5
    x, y = panel.lines[-1].get_data()
    assert (x[0], x[1]) == (1.5, 1.5)
    assert tuple(y) == pytest.approx((5.0, 2.0))


def test_the_clock_of_a_leg():
    one = waveform(0.63, 0.2)
    t = np.linspace(0, 2, 50)
    np.testing.assert_allclose(motion.clock_angle(one, t), 8.0 * t - np.pi / 2, atol=1e-9)
    other = Motion(**{**vars(one), "clock_signal": GAITS["SGCS"]})
    assert np.abs(motion.clock_angle(other, t) - (8.0 * t - np.pi / 2)).max() > 0.5


def test_what_the_paper_fits_ends_at_the_largest_speed():
    trials = table()
    kept = trials.select(collect._up_to_the_fastest(trials))
    for phi in K:
        here, all_here = (np.abs(one.phi - phi) < 1e-6 for one in (kept, trials))
        fastest = trials.omega_rad_s[all_here][np.argmax(trials.speed_m_s[all_here])]
        assert kept.omega_rad_s[here].max() == pytest.approx(fastest)


@pytest.mark.slow
def test_the_command(tmp_path, capsys):
    write_csv(table(), tmp_path / "t.csv")
    points = Published("p", np.array([0.6]), np.array([8.0]), np.array([0.08]))
    assert points.source == "p"
    arguments = [str(tmp_path / "t.csv"), "--out", str(tmp_path / "a"), "--formats", "svg", "--beside"]
    assert atlas.main([*arguments, str(tmp_path / "t.csv")]) == 0
    said = capsys.readouterr().out
    assert "9 of 11 figures" in said
    assert "not drawn: two trials with bags" in said


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["--formats", "gif"], "gif"),
        (["--effects", "no_such"], "no_such"),
        (["--beside", "none.csv"], "none.csv"),
        (["--width", "100"], "100"),
        (["--out", "FILE"], "a folder is needed"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(given, named, tmp_path, capsys):
    write_csv(table(), tmp_path / "t.csv")
    given = [str(tmp_path / "t.csv") if word == "FILE" else word for word in given]
    out = [] if "--out" in given else ["--out", str(tmp_path / "a")]
    assert atlas.main([str(tmp_path / "t.csv"), *out, *given]) == 2
    said = capsys.readouterr().err
    assert named in said
    assert "Traceback" not in said
    assert not (tmp_path / "a").exists()


def test_every_force_needed_is_within_the_panel_and_the_outermost_are_named(material):
    figure, _ = force.force(material, 85.0)
    (panel,) = figure.axes
    (low, high), (left, right) = panel.get_ylim(), panel.get_xlim()
    needed = [line for line in panel.lines if line.get_color() == style.INK]
    seen = [y for line in needed for x, y in line.get_xydata() if left <= x <= right]
    assert low < min(seen) < max(seen) < high
    named = [words.get_text() for words in panel.texts]
    assert named[0] == "ω 30"
    assert {"ω 4", "ω 12", "ω 20"} >= set(named[1:])
    assert panel.get_legend().get_title().get_text() == "φ"


def test_lines_of_a_need_that_falls_are_named_where_they_lie_apart_and_what_is_crossed_fills_the_panel(
    material, monkeypatch
):
    """Above the slow phase a fast leg needs twice what the ground gives: the axis, and the labels, were there."""
    usual = force.forces

    def falling(fit, omega):
        at = usual(fit, omega)
        early = at.depth_m < np.nanmin(usual(fit, OMEGA[0]).holds_m) - 2e-4
        return replace(at, needed_n=np.where(early, at.needed_n.max() * 2 + 0.0 * at.needed_n, at.needed_n))

    steady, _ = force.force(material, 85.0)
    monkeypatch.setattr(force, "forces", falling)
    figure, _ = force.force(material, 85.0)
    (panel,) = figure.axes
    assert panel.get_ylim()[1] == pytest.approx(steady.axes[0].get_ylim()[1])
    lines = {f"ω {omega:g}": usual(material.fit, omega).needed_n[-1, -1] for omega in OMEGA}
    assert len(panel.texts) > 1
    for label in panel.texts:
        assert (label.xy[0], label.get_ha()) == (0.98, "right")
        assert label.xy[1] == pytest.approx(lines[label.get_text()])
    assert {label.get_ha() for label in steady.axes[0].texts} == {"left"}


def test_where_the_need_falls_is_said(material, two_gaits, monkeypatch):
    """Of a clock with a slow phase that the model minds; controls: it begins outside the panel, and no such clock."""
    of_phases = Material(**{**vars(material), "cells": two_gaits.cells, "fits": (two_gaits,)})
    assert "falls" not in force.force(of_phases, 85.0)[1]
    monkeypatch.setattr(force, "_shown_from_m", lambda *_: 0.0)
    assert "The force needed falls (dotted) at 2.82 cm, where the slow phase begins." in force.force(of_phases, 85.0)[1]
    assert "falls" not in force.force(material, 85.0)[1]


def test_the_largest_speed_at_the_frequencies_measured_is_beside_that_at_any(material):
    figure, caption = collapse.critical(material, 170.0)
    (circles,) = [line for line in figure.axes[1].lines if line.get_label() == "model at the ω measured"]
    best = [100 * material.fit.predicted[material.cells.level == n, 0].max() for n in range(len(K))]
    assert circles.get_ydata() == pytest.approx(best)
    assert "over the measured ω (circles)" in caption


def dots(panel):
    """Depths [cm] at which a figure says that legs hold."""
    return sorted(x for line in panel.lines if line.get_marker() == "o" for x in line.get_xdata() if np.isfinite(x))


@pytest.mark.parametrize("growth", [0.0, 0.02])
def test_dots_are_where_legs_hold_also_if_the_ground_gives_more_at_a_faster_leg(material, monkeypatch, growth):
    """Ground that hardens with ω was drawn as at the slowest, so that lines crossed where no leg holds."""
    usual = force.forces
    monkeypatch.setattr(
        force, "forces", lambda fit, omega: replace(at := usual(fit, omega), given_n=at.given_n * (1 + growth * omega))
    )
    figure, caption = force.force(material, 85.0)
    (panel,) = figure.axes
    holds = np.array([usual(material.fit, omega).holds_m for omega in OMEGA])
    assert dots(panel) == pytest.approx(sorted(100 * holds[np.isfinite(holds)]))
    coloured = [line for line in panel.lines if line.get_color() in style.phi_colours(len(K))]
    dashed = [line for line in coloured if line.get_linestyle() == "--"]
    assert len(dashed) == (len(K) if growth else 0)
    assert ("at 4 rad/s solid, at 30 dashed" in caption) == bool(growth)


@pytest.mark.parametrize("holds_m", [0.012, 0.04, np.nan])
def test_depths_at_which_legs_hold_are_within_the_panel(material, monkeypatch, holds_m):
    """The axis began at 0.65 of the greatest depth, SandBot's; another robot's legs held outside."""
    usual = force.forces
    monkeypatch.setattr(
        force, "forces", lambda fit, omega: replace(usual(fit, omega), holds_m=np.full(len(K), holds_m))
    )
    figure, caption = force.force(material, 85.0)
    low, high = figure.axes[0].get_xlim()
    assert all(low < depth < high for depth in dots(figure.axes[0]))
    assert ("never cross" in caption) == np.isnan(holds_m)
    assert (low == 0.0) == np.isnan(holds_m)


def test_another_robots_leg_is_drawn_whole_and_not_measured_by_the_papers(material):
    big = Material(**{**vars(material), "cells": replace(material.cells, robot=Robot(leg_radius_m=0.06))})
    (panel,) = leg.in_the_ground(big, 85.0)[0].axes
    assert max(line.get_ydata().max() for line in panel.lines) < panel.get_ylim()[1]
    assert "the paper prints" not in leg.step_against_depth(big, 85.0)[1]
    assert "the paper prints 5.0 cm" in leg.step_against_depth(material, 85.0)[1]


@pytest.mark.parametrize("draw", [collapse.critical, speeds.against_phi])
def test_a_legend_is_above_the_panel_where_lines_fill_it(material, draw):
    with style.typography():
        figure, _ = draw(material, 170.0)
        figure.draw_without_rendering()
    for panel in figure.axes:
        assert panel.get_legend().get_window_extent().y0 >= panel.get_window_extent().y1


@pytest.mark.parametrize("ends", [True, False])
def test_what_walks_at_every_frequency_is_in_the_legend_only_where_it_is_drawn(material, monkeypatch, ends):
    first = np.array([20.0, 30.0, 30.0 if ends else np.nan])
    monkeypatch.setattr(collapse, "collapse", lambda _: Collapse(np.array([12.0, 20.0, 20.0]), first, np.full(3, 0.2)))
    figure, _ = collapse.critical(material, 170.0)
    entries = [words.get_text() for words in figure.axes[0].get_legend().get_texts()]
    assert ("walks at every ω" in entries) is not ends


def test_speeds_of_two_trials_have_a_true_minus_sign(material):
    back = Material(**{**vars(material), "motions": (waveform(0.63, -0.2), waveform(0.59, 0.02))})
    assert "−20.0 cm/s (90 % of the time −20.0 to −20.0)" in motion.speeds(back, 85.0)[1]


def test_motion_needs_two_trials(material):
    with pytest.raises(InputError, match="two trials with bags"):
        motion.speeds(material, 85.0)
    assert material.robot == SANDBOT


def stepped(y):
    """Pieces drawn of a line over 0, 1, 2, ..., the uprights last."""
    with style.typography():
        _, (panel,) = style.sheet(85.0, 60.0)
        style.stepped_line(panel, np.arange(len(y), dtype=float), np.array(y, dtype=float), 1.0, color="black")
    return [line.get_xydata().tolist() for line in panel.lines]


def test_a_jump_is_drawn_upright_and_a_slope_is_not():
    assert stepped([5, 5, 2, 2]) == [[[0, 5], [1, 5], [1.5, 5]], [[1.5, 2], [2, 2], [3, 2]], [[1.5, 5], [1.5, 2]]]
    assert stepped([5, 4.5, 4, 3.5]) == [[[0, 5], [1, 4.5], [2, 4], [3, 3.5]]]


def test_a_grid_point_amid_a_jump_belongs_to_neither_side():
    assert stepped([5, 5, 3.5, 2, 2]) == [[[0, 5], [1, 5], [2, 5]], [[2, 2], [3, 2], [4, 2]], [[2, 5], [2, 2]]]
