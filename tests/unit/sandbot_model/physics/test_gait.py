import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sandbot_bringup.plan import Plan
from sandbot_clock.gait import PRESETS, Gait, leg_angles
from sandbot_common.robot import SANDBOT
from sandbot_model.data.conditions import cells_of
from sandbot_model.physics.gait import (
    GAITS,
    assumption,
    clock,
    clock_signal,
    duty,
    first_step_rad,
    peaks_resolved,
    slow_phase_ratio,
)
from sandbot_model.physics.geometry import depth_at
from sandbot_model.physics.walking import Inputs, Walker
from sandbot_model.report.provenance import limits
from sandbot_record.trials.table import Row, from_rows


def cells_with(gait):
    return cells_of(from_rows([Row(f"t{i}", 0.6, 1e-3, 8.0 + i, gait, 1, 0.1, speed_sd_m_s=1e-3) for i in range(3)]))


def test_the_presets_are_the_clocks():
    assert {name: (one.theta_s_rad, one.theta_0_rad, one.duty) for name, one in PRESETS.items()} == GAITS
    assert slow_phase_ratio("SGCS") == pytest.approx(0.389, abs=5e-4)
    assert slow_phase_ratio("HGCS") == pytest.approx(0.242, abs=5e-4)
    assert slow_phase_ratio("UNIFORM") == 1.0


TURN = 2 * np.pi
OTHERS = st.tuples(st.floats(0.5, 3.0), st.floats(-0.9, 0.9), st.floats(0.3, 0.7))


def turning_of(theta_s, theta_0, duty_of):
    return clock([f"CUSTOM({theta_s} {theta_0} {duty_of})"])


@given(OTHERS)
def test_the_slow_phases_share_follows_from_the_two_rates(signal):
    turning = turning_of(*signal)
    assume(abs(turning.slow_ratio[0] - turning.swing_ratio[0]) > 1e-3)
    assert duty(turning.slow_ratio, turning.swing_ratio)[0] == pytest.approx(signal[2])
    assert duty(np.ones(1), np.ones(1)) == 1.0


@given(OTHERS)
def test_a_first_step_lasts_until_both_tripods_are_equally_far_from_straight_below(signal):
    """By the clock's own legs, once they have begun nearer to that than to half a step from it."""
    turning = turning_of(*signal)
    t = np.linspace(0.0, TURN, 20001)
    mean = leg_angles(Gait(*signal), 1.0, t)[0].mean(axis=1) / np.pi
    begun = round(mean[0])
    assume(abs(mean[0] - begun) < 0.45)
    ends = np.interp(begun + 1, mean, t)
    said = first_step_rad(turning.slow_ratio, turning.swing_ratio, -turning.slow_begin_rad)
    # Long slow phases on both sides of half a period are beyond what is asked: a leg would stand twice.
    assume(abs(ends - np.pi) < TURN * min(abs(signal[2] - 0.5), 1 - signal[2], signal[2]))
    assert said[0] == pytest.approx(ends, abs=1e-3)


@given(OTHERS, st.floats(4.0, 30.0))
def test_the_longest_step_takes_half_a_period(signal, omega):
    """A robot whose legs stand that far takes as long for it as the next leg is behind."""
    inputs = Inputs(200.0, omega, 0.4, clock=turning_of(*signal))
    longest = Walker().chain(inputs, [], np.array([0.01]), first_step=False).longest_step.item()
    assume(longest < 1.999 * SANDBOT.leg_radius_m)
    depth = depth_at(SANDBOT, np.arcsin(longest / (2 * SANDBOT.leg_radius_m)))
    assume(depth > 0)
    stands = Walker().chain(inputs, [], np.array([depth]), first_step=False)
    assert stands.chord.item() == pytest.approx(longest)
    assert stands.standing_time.item() == pytest.approx(np.pi / omega)


def test_legs_that_turn_at_one_rate_are_never_cut_short():
    even = Walker().chain(Inputs(200.0, 12.0, 0.4), [], np.array([0.01]), first_step=False)
    assert even.longest_step.item() == pytest.approx(2 * SANDBOT.leg_radius_m)


def resolved(gait, omega, stance_rad=(np.nan, np.nan), mount_rad=0.0):
    return bool(peaks_resolved(clock([gait]), omega, tuple(map(np.array, stance_rad)), mount_rad, 100.0)[0])


def test_a_peak_in_the_fast_phase_must_last_long_enough_to_be_seen():
    assert resolved("UNIFORM", 30.0)
    assert resolved("SGCS", 16.0)
    assert not resolved("SGCS", 30.0)


def test_a_peak_counts_where_the_lift_tells_which_phase_it_is_of():
    """SGCS mounted half a radian ahead is slow for 0.55 rad to either side."""
    assert resolved("SGCS", 30.0, (0.40, 0.45), 0.5)  # all of the stance is slow
    assert not resolved("SGCS", 4.0, (0.52, 0.58), 0.5)  # that may be so or not
    assert resolved("SGCS", 4.0, (0.66, 0.70), 0.5)  # it is not, and the fast part lasts
    assert not resolved("SGCS", 16.0, (0.66, 0.70), 0.5)


def test_a_custom_gait_of_a_plan_is_the_models_too():
    hard = {"theta_s_rad": 0.85, "theta_0_rad": 0.13, "duty": 0.56}
    plan = Plan("own", (0.6,), (8.0,), gait="CUSTOM", gait_parameters=hard)
    assert plan.gait_name == "CUSTOM(0.85 0.13 0.56)"
    assert Plan("ours", (0.6,), (8.0,), gait="HGCS").gait_name == "HGCS"
    assert slow_phase_ratio(plan.gait_name) == slow_phase_ratio("HGCS")
    assert resolved(plan.gait_name, 30.0) == resolved("HGCS", 30.0)
    assert cells_with(plan.gait_name).clock.slow_ratio == pytest.approx(slow_phase_ratio("HGCS"))
    assert assumption([plan.gait_name, "UNIFORM"]) == ""


@pytest.mark.parametrize(
    "gait",
    ["", "CUSTOM", "trot", "CUSTOM(1 2)", "CUSTOM(a b c)", "CUSTOM(7 0 .5)", "CUSTOM(1 0 1)", "CUSTOM(nan 0 .5)"],
)
def test_a_gait_that_tells_nothing_is_taken_for_another_and_the_user_is_told(gait):
    assert clock_signal(gait) is None
    assert slow_phase_ratio(gait) == slow_phase_ratio("SGCS")
    assert "the clock signal of SGCS is assumed" in assumption(["UNIFORM", gait])
    assert any(repr(gait) in note or "not given" in note for note in limits(cells_with(gait)))
    assert not any("assumed" in note for note in limits(cells_with("UNIFORM")))
