"""Penetrometer readings: reading the file, what they do to a fit, and what they show that trials can't."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import Readings, at_levels, read_readings
from sandbot_model.discovery.verdict import passes
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.jacobian import readings_jacobian
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import KCurve

EFFECTS = catalogue()
D_R = 0.039
"""SandBot's depth of a stiffness [m]."""
SMALL = Robot(leg_radius_m=0.012, axle_height_m=0.008, mass_per_leg_kg=0.02, leg_width_m=0.004, stiffness_depth_m=0.013)
PHI = np.repeat(np.linspace(0.58, 0.633, 5), 4)
DEPTH = np.tile([0.015, 0.025, 0.035, 0.044], 5)
K = np.interp(PHI, [0.58, 0.6, 0.633], [170.0, 205.0, 220.0])


def readings(force, seed=0, sd=0.01):
    rng = np.random.default_rng(seed)
    return Readings(PHI, DEPTH, force * (1 + sd * rng.normal(size=len(force))), sd * force)


def fitted(trials, table, effects=()):
    return fit(model_of("simple", effects, EFFECTS), cells_of(trials, table))


def test_readings_that_agree_leave_the_model_as_it_was(drawn):
    trials = drawn(seed=3)
    alone, both = fit(model_of("simple", (), EFFECTS), cells_of(trials)), fitted(trials, readings(K * DEPTH))
    assert passes(both)
    assert both.goodness.lack_of_fit["penetration"] > 1e-3
    assert np.abs(both.k_n_per_m - alone.k_n_per_m).max() < 2.0
    # Not by much: what trials say of the scale of k is better than a gauge's.
    assert (both.k_stderr_n_per_m < alone.k_stderr_n_per_m).all()


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_gauge_off_by_its_scale_leaves_the_model_as_it_was_and_one_reading_off_does_not(drawn, factor):
    """Readings at 1 % each that share 3 %: as if each were 3 off for a reason of its own, this claimed effects."""
    trials = drawn(seed=3)
    alone, both = fit(model_of("simple", (), EFFECTS), cells_of(trials)), fitted(trials, readings(factor * K * DEPTH))
    assert passes(both)
    assert np.abs(both.k_n_per_m / alone.k_n_per_m - 1).max() < 0.01
    one = K * DEPTH
    one[7] *= factor**3
    assert not passes(fitted(trials, readings(one)))


@pytest.mark.parametrize(
    ("name", "force", "truth"),
    [
        ("cohesion", K * DEPTH + 2 * 300 * 0.012 * 0.0355, 300.0),
        ("depth_nonlinearity", K * D_R * (DEPTH / D_R) ** 1.2, 1.2),
    ],
)
def test_readings_show_the_law_of_force_that_trials_hide(drawn, name, force, truth):
    trials = drawn((name,), seed=4, values={"cohesion": {"c_pa": 300.0}, "depth_nonlinearity": {"n": 1.2}})
    assert passes(fit(model_of("simple", (), EFFECTS), cells_of(trials)))
    assert not passes(fitted(trials, readings(force)))
    found = fitted(trials, readings(force), (name,))
    assert passes(found)
    (value, stderr) = next(one for key, one in found.parameters.items() if key.startswith(name))
    assert abs(value - truth) < 4 * stderr


def test_the_slope_of_the_readings_is_that_of_their_difference(drawn):
    state = fitted(drawn(seed=5), readings(K * DEPTH), ("cohesion",))
    problem, at = state.problem, state.state
    slopes = readings_jacobian(problem, at)[0]
    for index in range(at.theta.shape[1]):
        theta = at.theta.copy()
        theta[0, index] += (step := 1e-4 * max(abs(theta[0, index]), 1e-3))
        change = (at.pressed - problem.pressed(theta, at.ln_k, at.slope))[0] / step
        assert slopes[:, index] == pytest.approx(change, rel=1e-3, abs=1e-6)
    for level in range(at.ln_k.shape[1]):
        ln_k = at.ln_k.copy()
        ln_k[0, level] += 1e-5
        change = (at.pressed - problem.pressed(at.theta, ln_k, at.slope))[0] / 1e-5
        assert slopes[:, at.theta.shape[1] + level] == pytest.approx(change, rel=1e-3, abs=1e-4)


def test_a_reading_feels_the_ground_at_another_volume_fraction_as_legs_do(drawn):
    """With k -> K(φ + c), a leg pressed and a first step meet the same k; K(φ) is the reading's own."""
    effects = catalogue(formulas=["denser: strength: k -> K(phi + c); c in -0.02..0.02"])
    problem = Problem(model_of("simple", ("denser",), effects), cells_of(drawn(seed=5), readings(K * DEPTH)))
    phi = problem.cells.level_phi
    curve, depth = KCurve(phi, np.interp(phi, PHI[::4], K[::4])), np.full(len(phi), D_R)
    ln_k = np.log(curve.k_n_per_m)

    def met(c, k):
        return problem.press(np.array([0.4, 0.02, c]), ln_k, k, phi, depth) / D_R

    assert met(0.0, curve.k_n_per_m + 3.0) == pytest.approx(curve.k_n_per_m + 3.0)
    assert met(0.01, curve.k_n_per_m) == pytest.approx(curve(phi + 0.01))
    inputs, params = problem.model.inputs(np.array([0.4, 0.02, 0.01]), curve.k_n_per_m, 8.0, phi, k_of_phi=curve)
    legs = problem.model.walker.chain(inputs, params, np.array([D_R]), first_step=True).k
    assert met(0.01, curve.k_n_per_m) == pytest.approx(np.broadcast_to(legs, (len(phi), 1))[:, 0])
    rows = np.log(np.stack([curve.k_n_per_m, 1.1 * curve.k_n_per_m]))
    both = problem.press(np.array([[0.4, 0.02, 0.01]] * 2), rows, np.exp(rows), phi, depth)
    np.testing.assert_allclose(both / D_R, np.outer([1.0, 1.1], curve(phi + 0.01)))


def test_a_fit_says_of_a_pressed_leg_what_its_first_steps_meet(drawn):
    found = fitted(drawn(seed=5), readings(K * DEPTH))
    effects = catalogue(formulas=["denser: strength: k -> K(phi + 0.01)"])
    denser = fitted_at(model_of("simple", ("denser",), effects), found.cells, found.point)
    where, depth = np.array([0.59, 0.61]), np.full(2, D_R)
    expected = found.press(where + 0.01, depth)[0]
    assert denser.press(where, depth)[0] == pytest.approx(expected)
    assert found.press(where, depth)[0] != pytest.approx(expected)


@pytest.mark.parametrize(("robot", "depth_m"), [(SANDBOT, D_R), (SMALL, 0.013)])
def test_a_file_of_forces_and_one_of_stiffness_say_the_same(tmp_path, robot, depth_m):
    forces, stiffness = tmp_path / "forces.csv", tmp_path / "k.csv"
    forces.write_text(f"phi,depth_m,force_n,force_sd_n\n0.6,{depth_m},{200 * depth_m},{2.5641 * depth_m}\n")
    stiffness.write_text("phi, k_n_per_m, k_sd_n_per_m\n0.6, 200, 2.5641\n")
    one, other = (at_levels(read_readings(path), np.array([0.6]), robot) for path in (forces, stiffness))
    for name in ("depth", "force", "sd"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12)


def test_a_force_is_at_its_own_depth_whoever_walked(tmp_path):
    path = tmp_path / "forces.csv"
    path.write_text("phi,depth_m,force_n\n0.6,0.02,4\n0.6,0.03,6\n")
    one, other = (at_levels(read_readings(path), np.array([0.6]), robot) for robot in (SANDBOT, SMALL))
    for found in (one, other):
        assert found.depth.tolist() == [0.02, 0.03]
        assert found.force.tolist() == [4.0, 6.0]
        assert found.sd == pytest.approx([0.08, 0.12])


@pytest.mark.parametrize("robot", [SANDBOT, SMALL])
def test_a_stiffness_is_pressed_at_the_depth_of_the_robot_that_walked(drawn, robot):
    """Of readings k, a leg of this robot pressed to its d_r meets k d_r, whatever the exponent of the force is."""
    unknown = np.full(len(PHI), np.nan)
    told = Readings(PHI, unknown, unknown, unknown, stiffness=(K, 0.02 * K))
    cells = cells_of(dataclasses.replace(drawn(levels=5), robot=robot), told)
    assert set(cells.pressed.depth.tolist()) == {robot.stiffness_depth_m}
    problem = Problem(model_of("simple", ("depth_nonlinearity",), EFFECTS, robot), cells)
    theta = np.array([{"depth_nonlinearity.n": 1.4, "delta_t_s": 0.4}.get(name, 0.02) for name in problem.model.names])
    missed = problem.pressed(theta[None], np.log(K[::4])[None], np.zeros((1, 5)))
    np.testing.assert_allclose(missed, 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "columns"),
        ("phi,depth_m,force_n\n", "no readings: nothing below the header"),
        ("phi,force_n\n0.6,3\n", "columns phi, depth_m, force_n or phi, k_n_per_m are needed; there are: phi, force_n"),
        ("phi,depth_cm,force_n\n0.6,3,5\n", "'depth_cm' is not known, did you mean 'depth_m'. Divide cm by 100"),
        ("phi,depth_m,forc_n\n0.6,.03,5\n", "'forc_n' is not known, did you mean 'force_n'.$"),
        ("phi,k_n_m\n0.6,200\n", "'k_n_m' is not known, did you mean 'k_n_per_m'"),
        ("phi,depth_m,force_n\n0.6,0.03,x\n", "row 2, force_n"),
        ("phi,depth_m,force_n\n0.6,0.03,nan\n", "row 2, force_n"),
        ("phi,depth_m,force_n\n0.6,0.03,1_0\n", "row 2, force_n: '1_0' is not a number"),
        ("phi,depth_m,force_n\n0.6,0.03,−3\n", "row 2, force_n: −3 is not between 0 and 1000"),
        ("phi,depth_m,force_n\n6,0.03,5\n", "row 2, phi"),
        ("phi,depth_m,force_n\n0.6,3,5\n", "row 2, depth_m"),
        ("phi,depth_m,force_n,force_sd_n\n0.6,0.03,5,0\n", "row 2, force_sd_n"),
        ("phi,depth_m,force_n,force_sd\n0.6,0.03,5,0.01\n", "'force_sd' is not known, did you mean 'force_sd_n'"),
        ("phi,k_n_per_m,k_sd\n0.6,200,1\n", "'k_sd' is not known, did you mean 'k_sd_n_per_m'"),
        ("phi,depth_m,force_n\n0.6,0.03\n", "row 2: 2 values for 3 columns"),
    ],
)
def test_a_bad_file_is_one_line(tmp_path, text, message):
    path = tmp_path / "readings.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_readings(path)
    assert "\n" not in str(caught.value)


@given(st.binary(max_size=200))
def test_any_bytes_give_readings_or_one_line(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("readings") / "readings.csv"
    path.write_bytes(content)
    try:
        found = read_readings(path)
    except InputError as error:
        message = str(error)
    else:
        message = ""
        assert np.isfinite(found.of(SANDBOT).force_n).all()
    assert "\n" not in message


def test_readings_elsewhere_are_refused_and_strays_left_out():
    levels = np.array([0.59, 0.61])
    table = Readings(*(np.array(column) for column in ([0.591, 0.63], [0.02, 0.02], [4.0, 4.0], [0.1, 0.1])))
    found = at_levels(table, levels, SANDBOT)
    assert len(found) == 1
    assert found.notes == ("penetrometer: 1 of 2 readings is at no level of the trials: φ 0.630",)
    assert not at_levels(table, np.array([0.591, 0.63]), SANDBOT).notes
    with pytest.raises(InputError, match=r"0\.591-0\.630"):
        at_levels(table, np.array([0.55]), SANDBOT)


@pytest.mark.parametrize(
    ("columns", "unread"),
    [
        ("depth_m,force_n,force_sd_n,note,force_sd", "note, force_sd"),
        ("depth_m,k_n_per_m,note,sd,x", "depth_m, note, sd, x"),
    ],
)
def test_a_column_that_is_none_of_a_reading_is_told(tmp_path, columns, unread):
    path = tmp_path / "readings.csv"
    path.write_text(f"phi,{columns}\n0.6,0.02,4,0.1,0.2,0.3\n")
    (note,) = at_levels(read_readings(path), np.array([0.6]), SANDBOT).notes
    assert note == f"penetrometer: columns that are not read: {unread}"
