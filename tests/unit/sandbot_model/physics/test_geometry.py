"""The rolling circle: depth, lift, step and leg angle say the same."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.robot import Robot
from sandbot_model.physics.geometry import angle_at, chord, deepest_m, depth_at, stance_angle, step_from_lift

ROBOT = Robot()
R = ROBOT.leg_radius_m
STANDING = st.floats(R - ROBOT.axle_height_m, deepest_m(ROBOT))
"""Depths at which the belly touches and the leg's centre is above its foot."""


@given(STANDING)
def test_lift_and_depth_give_one_step(depth):
    lift = deepest_m(ROBOT) - depth
    np.testing.assert_allclose(step_from_lift(np.asarray(lift), R), chord(ROBOT, np.asarray(depth)), atol=1e-9)


@given(STANDING)
def test_the_axle_falls_by_the_lift_at_the_ends_of_a_step(depth):
    angle = stance_angle(chord(ROBOT, np.asarray(depth)), R)
    assert R * (1 - np.cos(angle)) == pytest.approx(deepest_m(ROBOT) - depth, abs=1e-9)


@given(STANDING, STANDING)
def test_a_deeper_leg_steps_shorter(one, other):
    shallow, deep = chord(ROBOT, np.array(sorted((one, other))))
    assert deep <= shallow


@given(st.floats(0.01, 1.5))
def test_a_depth_has_its_angle(angle_rad):
    assert angle_at(ROBOT, depth_at(ROBOT, angle_rad)) == pytest.approx(angle_rad, rel=1e-9)


def test_nothing_beyond_the_ends():
    assert step_from_lift(np.asarray(-1e-3), R) == 0.0
    assert chord(ROBOT, np.asarray(deepest_m(ROBOT) + 1e-3)) == 0.0
    assert stance_angle(np.asarray(3 * R), R) == np.pi / 2
    assert np.isnan(step_from_lift(np.asarray(np.nan), R))
