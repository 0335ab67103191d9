"""Every effect of the catalogue: described, vanishing at its neutral value, composing with the others."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbot_common.robot import Robot
from sandbot_model.physics.effect import STAGES
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.gait import clock
from sandbot_model.physics.walking import Inputs, KCurve, Walker

OMEGA = np.array([4.0, 12.0, 20.0, 30.0])
K = np.array([172.0, 190.0, 205.0, 225.0])[:, None]
CURVE = KCurve(np.array([0.58, 0.6, 0.633]), np.array([170.0, 205, 220]))
SGCS = clock(["SGCS"])[0]
INPUTS = Inputs(K, OMEGA, 0.4, 0.62, 0.02, SGCS, CURVE)
BASE = Walker().predict(INPUTS).observables
SPREAD_ONLY = {"phi_nonuniformity"}
"""Acts on the average over φ, not on a single prediction."""


def start(effect):
    return {one.name: one.start for one in effect.parameters}


def seen(effect, **changed):
    return Walker((effect,)).predict(INPUTS, [{**start(effect), **changed}]).observables


EACH = pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.identifier)


@EACH
def test_is_described(effect):
    assert effect.stage in STAGES
    assert effect.formula
    assert effect.source
    assert effect.seen_in
    for one in effect.parameters:
        low, high = one.search
        assert low <= one.low < one.start <= one.high <= high
        assert one.doc


def test_there_are_all_of_the_catalogue_once():
    names = [effect.identifier for effect in CATALOGUE]
    assert len(names) == len(set(names)) > 0


@EACH
def test_changes_something_at_its_start(effect):
    if effect.identifier not in SPREAD_ONLY:
        assert np.abs(seen(effect) - BASE).max() > 1e-5


@EACH
def test_vanishes_at_its_neutral_values(effect):
    neutral = {one.name: one.neutral for one in effect.parameters if one.neutral is not None}
    if neutral and effect.identifier != "slow_phase_speed":
        np.testing.assert_allclose(seen(effect, **neutral), BASE, atol=1e-12)


def test_slow_phase_speed_vanishes_for_uniform_rotation():
    effect = next(one for one in CATALOGUE if one.identifier == "slow_phase_speed")
    uniform = Inputs(K, OMEGA, 0.4)
    np.testing.assert_allclose(
        Walker((effect,)).predict(uniform, [{"rho": 1.0}]).observables,
        Walker().predict(uniform).observables,
        atol=1e-12,
    )


@pytest.mark.parametrize(("mount", "cut"), [(0.5, True), (0.0, False)])
def test_a_step_is_no_longer_than_the_chord_of_the_slow_phase(mount, cut):
    """SGCS centred under the axle is slow for 0.55 rad to either side; as mounted on SandBot, for 1.05 rad before."""
    effect = next(one for one in CATALOGUE if one.identifier == "slow_phase_speed")
    walker = Walker((effect,), Robot(leg_mount_rad=mount))
    strong = Inputs(np.array([185.0, 220.0, 240.0]), 16.0, 0.18, 0.62, 0.02, SGCS)
    steps = walker.predict(strong, [{"rho": 1.0}]).step_m / walker.robot.leg_radius_m
    chord = 2 * np.sin(0.55)
    assert steps[0] < 0.95 * chord  # the balance decides, at the slow rate
    assert (np.abs(steps[1:] / chord - 1) < 1e-6).all() if cut else (steps[1:] > 1.05 * chord).all()
    # Ground that holds a leg at the swing's rate, too, takes hold before.
    hard = Inputs(300.0, 16.0, 0.18, 0.62, 0.02, SGCS)
    assert float(walker.predict(hard, [{"rho": 1.0}]).step_m) > 1.1 * chord * walker.robot.leg_radius_m


def test_the_peak_is_of_the_phase_that_the_stance_reaches_and_the_first_step_begins_with_the_slow_one():
    """SGCS, slow for 0.55 rad to either side of straight below: a wider stance has its peak where it leaves that."""
    effect = next(one for one in CATALOGUE if one.identifier == "slow_phase_speed")
    walker = Walker((effect,), Robot(leg_mount_rad=0.5))
    radius = walker.robot.leg_radius_m
    beyond = SGCS.swing_ratio * np.cos(0.55)
    seen = walker.predict(
        Inputs(np.array([185.0, 220.0, 400.0]), 16.0, 0.18, 0.62, 0.02, SGCS), [{"rho": SGCS.slow_ratio}]
    )
    largest = seen.peak_speed_m_s / (16.0 * radius)
    np.testing.assert_allclose(largest, [SGCS.slow_ratio, SGCS.slow_ratio, beyond], rtol=1e-3)
    np.testing.assert_allclose(seen.first_step_m[:2], seen.step_m[:2], rtol=1e-6)
    assert float(seen.first_step_m[2]) == pytest.approx(2 * radius * np.sin(0.55), rel=1e-4)
    assert float(seen.step_m[2]) > 1.1 * float(seen.first_step_m[2])


@settings(max_examples=40)
@given(st.lists(st.sampled_from(range(len(CATALOGUE))), min_size=2, max_size=4, unique=True))
def test_any_set_composes_to_finite_observables(which):
    effects = [CATALOGUE[i] for i in sorted(which)]
    found = Walker(tuple(effects)).predict(INPUTS, [start(effect) for effect in effects])
    assert np.isfinite(found.observables).all()
    assert (found.speed_m_s >= 0).all()
    assert (found.lift_m >= 0).all()


COMMUTING = [
    e
    for e in CATALOGUE
    if e.identifier
    not in {
        "crater_refill",
        "exact_leg_arc",
        "depth_nonlinearity",
        "resistive_force_theory",
        "finite_depth",
        "unequal_leg_load",
        "bed_slope",
    }
]


@settings(max_examples=40)
@given(st.lists(st.sampled_from(range(len(COMMUTING))), min_size=2, max_size=2, unique=True))
def test_order_does_not_matter_between_stages(which):
    one, other = (COMMUTING[i] for i in which)
    if one.stage != other.stage:
        there = Walker((one, other)).predict(INPUTS, [start(one), start(other)]).observables
        back = Walker((other, one)).predict(INPUTS, [start(other), start(one)]).observables
        np.testing.assert_array_equal(there, back)


def test_disturbed_ground_spares_the_first_step_and_collapses_the_rest():
    """Physics §7: at (.633, 24 rad/s) the first step keeps its pace while the following swim."""
    effect = CATALOGUE[0]
    assert effect.identifier == "disturbed_ground"
    inputs = Inputs(220.0, 24.0, 0.4)
    undisturbed, found = (
        Walker().predict(inputs),
        Walker((effect,)).predict(inputs, [{"k_l_n_per_m": 170.0, "s_c": 1.05}]),
    )
    assert not found.walking
    assert float(found.first_step_m) == float(undisturbed.first_step_m)
    assert 24 * float(found.first_step_m) / np.pi == pytest.approx(0.26, abs=0.005)


def test_disturbed_ground_never_strengthens():
    effect = CATALOGUE[0]
    inputs = Inputs(168.0, 2.0, 0.4)
    found = Walker((effect,)).predict(inputs, [{"k_l_n_per_m": 185.0, "s_c": 1.0}])
    assert float(found.speed_m_s) == float(Walker().predict(inputs).speed_m_s)


def test_equivalent_effects_are_equivalent():
    """A cable's drag, an uphill slope and slip all take a share that falls with depth squared."""
    by_name = {effect.identifier: effect for effect in CATALOGUE}
    slip = Walker((by_name["leg_slip"],)).predict(INPUTS, [{"sigma": 0.1}]).observables
    force = 1.5 * 146e3 * 0.012 * 0.039**2
    drag = Walker((by_name["cable_drag"],)).predict(INPUTS, [{"f_c_n": 0.1 * force}]).observables
    np.testing.assert_allclose(slip, drag, atol=1e-9)
