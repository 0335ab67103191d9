"""The base models against certified numbers, and what must hold for any parameters."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize_scalar

from sandbot_common.robot import Robot
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.geometry import chord, critical_k_n_per_m, deepest_m
from sandbot_model.physics.walking import BASES, Inputs, KCurve, Walker

REFERENCE = yaml.safe_load((Path(__file__).parents[4] / "reference" / "walking.yaml").read_text())
EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
ROBOT = Robot()
R, W = ROBOT.leg_radius_m, ROBOT.leg_width_m
STILL = 1e-9


def simple(k, omega, delta_t=0.4):
    return Walker().predict(Inputs(k, omega, delta_t))


def full(alpha, omega, delta_t):
    walker = Walker(tuple(EFFECTS[name] for name in BASES["full"]))
    return walker.predict(Inputs(np.asarray(alpha) * W * R, omega, delta_t), [{}, {}])


def agrees(value, expected, digits):
    return abs(float(value) - expected) <= 0.5001 * 10.0**-digits


def test_depth_and_step_at_rest():
    for case in REFERENCE["resting_depth"]:
        found = simple(case["k_n_per_m"], STILL)
        assert agrees(found.depth_m, case["depth_m"], case["depth_digits"])
        assert agrees(found.step_m / R, case["step_over_r"], case["step_digits"])


def test_stiffness_that_gives_a_step_at_rest():
    whole, none = REFERENCE["resting_stiffness"]
    k = brentq(lambda k: float(simple(k, STILL).step_m) / R - whole["step_over_r"], 170, 200)
    assert agrees(k, whole["k_n_per_m"], whole["digits"])
    assert agrees(critical_k_n_per_m(ROBOT), none["k_n_per_m"], none["digits"])
    assert not simple(critical_k_n_per_m(ROBOT) - 0.01, STILL).walking


def test_step_geometry_and_critical_depth():
    case = REFERENCE["step_geometry"]
    depth = brentq(lambda d: float(chord(ROBOT, np.array(d))) / R - case["step_over_r"], 0.03, 0.045)
    assert agrees(depth, case["depth_m"], case["digits"])
    critical = REFERENCE["critical_depth_m"]
    assert agrees(brentq(lambda d: float(chord(ROBOT, np.array(d))) / R - 1, 0.03, 0.045), critical["at_s_equal_R"], 5)
    assert agrees(deepest_m(ROBOT), critical["deepest"], critical["digits"])


def test_simple_speed():
    for case in REFERENCE["simple_speed"]:
        found = simple(case["k_n_per_m"], 16.0)
        assert agrees(found.speed_m_s, case["speed_m_s"], case["speed_digits"])
        assert agrees(found.depth_m, case["depth_m"], case["depth_digits"])


def test_simple_maximum_and_its_ends():
    case = REFERENCE["simple_maximum"]
    best = minimize_scalar(lambda w: -float(simple(case["k_n_per_m"], w).speed_m_s), bounds=(15, 35), method="bounded")
    assert agrees(-best.fun, case["speed_m_s"], case["speed_digits"])
    assert agrees(best.x, case["omega_rad_s"], 1)
    at_r = brentq(lambda w: float(simple(case["k_n_per_m"], w).step_m) / R - 1, 15, 30)
    assert agrees(at_r, case["s_equal_R_rad_s"], 1)
    assert simple(case["k_n_per_m"], case["s_zero_rad_s"] - 0.06).walking
    assert not simple(case["k_n_per_m"], case["s_zero_rad_s"] + 0.06).walking


def test_full_speed():
    case = REFERENCE["full_speed"]
    found = full(case["alpha_n_per_m3"], np.array(case["omega_rad_s"], dtype=float), case["delta_t_s"])
    for value, expected in zip(found.speed_m_s, case["speed_m_s"], strict=True):
        assert agrees(value, expected, 3)


def test_full_force():
    case = REFERENCE["full_force"]
    depth = np.array(case["depth_m"])
    walker = Walker((EFFECTS["exact_leg_arc"],))
    force = walker.chain(Inputs(1.0, 1.0, 1.0), [{}], depth, first_step=False).force
    for value, expected in zip(force / depth, case["ratio"], strict=True):
        assert agrees(value, expected, 3)

    def lacking(depth):
        return -float(walker.chain(Inputs(W * R, 1.0, 1.0), [{}], np.array([depth]), first_step=False).force[0])

    peak = minimize_scalar(lacking, bounds=(0.03, 0.046), method="bounded", options={"xatol": 1e-7})
    assert agrees(peak.x, case["peak_depth_m"], 4)
    weight = ROBOT.mass_per_leg_kg * ROBOT.gravity_m_s2
    assert agrees(weight / -peak.fun / 1e3, case["least_alpha_n_per_m3"] / 1e3, 0)


def test_full_depth():
    case = REFERENCE["full_depth"]
    found = full(300e3, np.array([STILL, *case["omega_rad_s"][1:]]), 0.15)
    for value, expected in zip(found.depth_m, case["depth_m"], strict=True):
        assert agrees(value, expected, 4)


def test_full_model_does_not_collapse_but_too_soft_ground_swims():
    assert full(330e3, np.linspace(4, 60, 30), 0.2).walking.all()
    assert not full(240e3, 8.0, 0.2).walking


walkable = {"k": st.floats(165, 400), "omega": st.floats(1, 30), "delta_t": st.floats(0.1, 2)}


@given(**walkable)
def test_sinks_deeper_on_faster_legs_and_less_on_stiffer_ground(k, omega, delta_t):
    here, faster, stiffer = simple([k, k, k * 1.05], [omega, omega * 1.05, omega], delta_t).depth_m
    if np.isfinite(here):
        assert stiffer < here
        assert not faster <= here  # deeper, or NaN: swims


@given(**walkable)
def test_lift_and_step_keep_the_geometry_lock(k, omega, delta_t):
    found = simple(k, omega, delta_t)
    if found.walking:
        lift = float(found.lift_m)
        assert float(found.step_m) == pytest.approx(2 * np.sqrt(lift * (2 * R - lift)), abs=1e-9)
        assert float(found.speed_m_s) == pytest.approx(omega * float(found.step_m) / np.pi, rel=1e-9)
        assert float(found.first_step_m) == float(found.step_m)
    else:
        assert float(found.lift_m) == 0
        assert float(found.speed_m_s) == float(found.peak_speed_m_s) == 0.02
        assert float(found.first_step_m) == pytest.approx(0.02 * np.pi / (2 * omega))


@settings(max_examples=30)
@example(k=184.0, omega=1.0, names={"cable_drag", "dilation"})
@given(
    k=st.floats(165, 400),
    omega=st.floats(1, 30),
    names=st.sets(st.sampled_from(sorted(EFFECTS)), min_size=1, max_size=3),
)
def test_the_depth_found_is_the_first_that_holds(k, omega, names):
    """Against a scan of the margin on a fine grid, for any set of effects."""
    effects = tuple(effect for name, effect in EFFECTS.items() if name in names)
    params = [{one.name: one.start for one in effect.parameters} for effect in effects]
    inputs = Inputs(k, omega, 0.4, 0.61, k_of_phi=KCurve(np.array([0.58, 0.63]), np.array([170.0, 220.0])))
    walker = Walker(effects)
    found = walker.footing(inputs, params)
    grid = np.linspace(0, deepest_m(ROBOT), 4001)
    margin = np.broadcast_to(walker.chain(inputs, params, grid, first_step=False).margin, grid.shape)
    holds = np.flatnonzero(margin >= 0)
    if len(holds):
        assert found.walking
        assert float(found.depth) < grid[holds[0]] + 2.5e-5
    if found.walking:
        assert abs(float(walker.margin(inputs, params, found.depth, first_step=False))) < 2e-2


def test_arrays_broadcast():
    found = simple(np.array([180.0, 220.0])[:, None], np.array([4.0, 8.0, 12.0]))
    assert found.speed_m_s.shape == found.walking.shape == (2, 3)
    assert found.observables.shape == (2, 3, 4)
