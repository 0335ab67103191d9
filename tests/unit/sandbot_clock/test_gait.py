import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_clock.gait import PRESETS, Gait, angle_of_phase, leg_angles, phase_of_angle
from sandbot_common.errors import InputError

GAITS = st.builds(Gait, st.floats(0.05, 6.2), st.floats(-3.1, 3.1), st.floats(0.05, 0.95))
OMEGAS = st.floats(0.5, 60)
PHASES = st.floats(-50, 50)


@pytest.mark.parametrize(("name", "beta"), [("SGCS", 0.389), ("HGCS", 0.242), ("UNIFORM", 1.0)])
def test_slow_phase_ratio_of_the_presets(name, beta):
    assert Gait.from_name(name).slow_phase_ratio == pytest.approx(beta, abs=5e-4)


@given(GAITS)
def test_stance_fractions_are_what_the_angles_do(gait):
    phase = (np.arange(20_000) + 0.5) / 20_000
    slope_slow = 2 * math.pi * gait.slow_phase_ratio
    stance = [np.mod(phase - lag, 1) < gait.duty for lag in (0, 0.5)]
    assert np.mean(stance[0] & stance[1]) == pytest.approx(max(0, 2 * gait.duty - 1), abs=2e-4)
    assert np.mean(~stance[0] & ~stance[1]) == pytest.approx(max(0, 1 - 2 * gait.duty), abs=2e-4)
    np.testing.assert_array_equal(angle_of_phase(gait, phase)[1][stance[0]], slope_slow)


def test_starts_with_tripod_a_at_its_stance_and_b_half_a_turn_behind():
    gait = PRESETS["SGCS"]
    angle, rate = leg_angles(gait, 8.0, 0.0)
    assert angle.shape == rate.shape == (6,)
    np.testing.assert_allclose(angle[:3], gait.theta_0_rad - gait.theta_s_rad / 2)
    half_a_turn_later, _ = leg_angles(gait, 8.0, math.pi / 8)
    np.testing.assert_allclose(angle[3:], half_a_turn_later[:3] - 2 * math.pi)
    np.testing.assert_allclose(rate[:3], gait.slow_phase_ratio * 8.0)


def test_uniform_turns_at_omega():
    t = np.linspace(0, 3, 50)
    angle, rate = leg_angles(PRESETS["UNIFORM"], 7.0, t)
    np.testing.assert_allclose(angle[:, 0], -math.pi / 2 + 7.0 * t)
    np.testing.assert_allclose(rate, 7.0)


def test_shapes_follow_the_times():
    assert leg_angles(PRESETS["SGCS"], 8.0, np.zeros((2, 3)))[0].shape == (2, 3, 6)


def test_tripods_have_as_many_legs_as_the_robot():
    three = leg_angles(PRESETS["SGCS"], 8.0, np.linspace(0, 1, 9))
    two = leg_angles(PRESETS["SGCS"], 8.0, np.linspace(0, 1, 9), tripod=2)
    for less, whole in zip(two, three, strict=True):
        np.testing.assert_array_equal(less, whole[:, [0, 1, 3, 4]])


@given(GAITS, OMEGAS, st.floats(0, 100))
def test_a_period_is_a_turn_and_tripods_are_half_a_period_apart(gait, omega, t):
    period = 2 * math.pi / omega
    now, later = leg_angles(gait, omega, t)[0], leg_angles(gait, omega, t + period)[0]
    np.testing.assert_allclose(later - now, 2 * math.pi, atol=1e-7)
    np.testing.assert_allclose(leg_angles(gait, omega, t + period / 2)[0][3:], now[:3], atol=1e-7)


@given(GAITS, OMEGAS, st.floats(0, 100), st.floats(1e-6, 0.01))
def test_continuous_and_never_backwards(gait, omega, t, dt):
    step = leg_angles(gait, omega, t + dt)[0] - leg_angles(gait, omega, t)[0]
    fastest = omega * max(gait.slow_phase_ratio, gait.fast_phase_ratio)
    assert np.all(step >= 0)
    assert np.all(step <= fastest * dt * (1 + 1e-6) + 1e-9)


@given(GAITS, OMEGAS, st.floats(0, 20))
def test_rate_is_the_derivative(gait, omega, t):
    h = 1e-6
    (before, rate_before), (after, rate_after) = leg_angles(gait, omega, t), leg_angles(gait, omega, t + h)
    smooth = rate_before == rate_after
    np.testing.assert_allclose(((after - before) / h)[smooth], rate_before[smooth], rtol=1e-4, atol=1e-4)


@given(GAITS, PHASES)
def test_phase_of_angle_inverts_angle_of_phase(gait, phase):
    assert phase_of_angle(gait, angle_of_phase(gait, phase)[0]) == pytest.approx(phase, abs=1e-9)


@pytest.mark.parametrize("values", [(0.0, 0.0, 0.5), (1.1, 9.0, 0.5), (1.1, 0.0, 1.0), (math.nan, 0.0, 0.5)])
def test_refuses_a_gait_out_of_bounds(values):
    with pytest.raises(InputError, match="gait: "):
        Gait(*values)


def test_refuses_an_unknown_name():
    with pytest.raises(InputError, match="'sgcs' is not one of SGCS, HGCS, UNIFORM"):
        Gait.from_name("sgcs")


@pytest.mark.parametrize("omega", [-1.0, math.nan, math.inf])
def test_refuses_a_bad_omega(omega):
    with pytest.raises(InputError, match="omega_rad_s"):
        leg_angles(PRESETS["SGCS"], omega, 0.0)
