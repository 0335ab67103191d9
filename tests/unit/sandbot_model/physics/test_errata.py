"""What docs/physics.md §4 says of the paper's slips, where it is a number that can be computed."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from sandbot_common.robot import SANDBOT
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.walking import BASES, Inputs, Walker

R = SANDBOT.leg_radius_m
OMEGA = np.linspace(2.0, 30.0, 57)
SIMPLE = Walker()
FULL = Walker(tuple(effect for effect in CATALOGUE if effect.identifier in BASES["full"]))


def curve(k, delta_t=0.4):
    """Speeds of the simple model, and where it walks as Li09's data do."""
    found = SIMPLE.predict(Inputs(k, OMEGA, delta_t))
    return found.speed_m_s, found.walking & (np.nan_to_num(found.step_m) >= 0.9 * R)


def refit(walker, params, speed, use, starts):
    """k [N/m] and Δt [s] of least squares."""

    def missed(x):
        return (walker.predict(Inputs(x[0], OMEGA, x[1]), params).speed_m_s - speed)[use]

    found = (least_squares(missed, start, diff_step=1e-3, x_scale=(10.0, 0.1)) for start in starts)
    return min(found, key=lambda one: one.cost).x


@pytest.mark.parametrize("k", [190.0, 205.0, 220.0])
@pytest.mark.parametrize(
    ("factor", "delta_t", "change"), [(0.87, (0.57, 0.62), (-0.09, -0.04)), (1 / 0.87, (0.235, 0.275), (0.06, 0.165))]
)
def test_lowering_the_speeds_lengthens_the_response_and_softens_the_ground(k, factor, delta_t, change):
    speed, use = curve(k)
    starts = [(k * scale, time) for scale in (0.92, 1.0, 1.1) for time in (0.25, 0.4, 0.6)]
    found_k, found_delta_t = refit(SIMPLE, (), factor * speed, use, starts)
    assert delta_t[0] < found_delta_t < delta_t[1]
    assert change[0] < found_k / k - 1 < change[1]


def test_the_full_model_refits_simple_curves_with_a_third_of_the_response_time():
    found = []
    for k in (190.0, 205.0, 220.0):
        speed, use = curve(k)
        starts = [(k * scale, time) for scale in (0.7, 0.85, 1.0) for time in (0.1, 0.15, 0.25)]
        found.append(refit(FULL, ({}, {}), speed, use, starts)[1])
    assert all(0.1 < delta_t < 0.155 for delta_t in found)


def test_the_captions_stiffness_is_in_dyn_per_cm():
    dyn_per_cm = 1e-5 / 1e-2
    assert SIMPLE.predict(Inputs(2.0e5 * dyn_per_cm, 1e-9, 0.4)).walking
    assert 1.75e5 * dyn_per_cm == pytest.approx(175.0)
    assert float(SIMPLE.predict(Inputs(2.0e5, 1e-9, 0.4)).depth_m) < 1e-4
