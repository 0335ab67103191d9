import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_clock.gait import PRESETS, Gait, leg_angles
from sandbot_clock.phase_clock import PhaseClock
from sandbot_common.errors import InputError

GAITS = st.builds(Gait, st.floats(0.05, 6.2), st.floats(-3.1, 3.1), st.floats(0.05, 0.95))
OMEGAS = st.floats(0.5, 60)
CHANGES = st.lists(st.tuples(st.floats(0.001, 2.0), st.one_of(GAITS, OMEGAS)), min_size=1, max_size=6)


def changed(clock, t, what):
    return clock.with_gait(t, what) if isinstance(what, Gait) else clock.with_omega(t, what)


def test_unchanged_it_is_the_gait():
    t = np.linspace(0, 5, 400)
    clock = PhaseClock(PRESETS["SGCS"], 8.0).started(0.0)
    for mine, gaits in zip(clock.at(t), leg_angles(PRESETS["SGCS"], 8.0, t), strict=True):
        np.testing.assert_allclose(mine, gaits)


@given(GAITS, OMEGAS, CHANGES)
def test_no_change_makes_a_leg_jump_or_turn_back(gait, omega, changes):
    clock, t = PhaseClock(gait, omega).started(0.0), 0.0
    for wait, what in changes:
        before = clock.at(t)[0]
        t += wait
        at_change = clock.at(t)[0]
        assert np.all(at_change - before >= -1e-9)
        clock = changed(clock, t, what)
        np.testing.assert_allclose(clock.at(t)[0], at_change, atol=1e-7)
        assert abs(clock.lead_b) <= 0.5 + 1e-9
        assert np.all(clock.at(t)[1] >= 0)


@given(GAITS, GAITS, OMEGAS, st.floats(0, 3))
def test_a_turn_after_a_change_of_gait_the_tripods_are_half_a_turn_apart(old, new, omega, t):
    clock = PhaseClock(old, omega).started(0.0).with_gait(t, new)
    period = 2 * math.pi / omega
    later = t + period * 1.01
    np.testing.assert_allclose(clock.at(later + period / 2)[0][3:], clock.at(later)[0][:3], atol=1e-6)


def test_during_that_turn_they_are_not():
    # The control: the two gaits put tripod B elsewhere, so right after the change it must still be catching up.
    clock = PhaseClock(PRESETS["HGCS"], 8.0).started(0.0).with_gait(0.1, PRESETS["SGCS"])
    assert abs(clock.lead_b) > 0.01


def test_the_rate_is_the_derivative_while_it_catches_up():
    clock = PhaseClock(PRESETS["HGCS"], 8.0).started(0.0).with_gait(0.1, PRESETS["SGCS"])
    t, h = np.linspace(0.1, 0.8, 300), 1e-7
    (before, rate), (after, rate_after) = clock.at(t), clock.at(t + h)
    smooth = rate == rate_after
    assert smooth.mean() > 0.95
    np.testing.assert_allclose(((after - before) / h)[smooth], rate[smooth], rtol=1e-5)


def test_stop_holds_and_start_goes_on():
    running = PhaseClock(PRESETS["SGCS"], 8.0).started(0.0)
    held = running.stopped(0.3)
    angle, rate = held.at(np.array([0.3, 5.0, 100.0]))
    np.testing.assert_allclose(angle, np.tile(running.at(0.3)[0], (3, 1)))
    np.testing.assert_array_equal(rate, 0.0)
    again = held.started(100.0)
    np.testing.assert_allclose(again.at(100.5)[0], running.at(0.8)[0])


def test_it_stands_still_before_it_is_started():
    np.testing.assert_array_equal(PhaseClock(PRESETS["SGCS"], 8.0).at(3.0)[1], 0.0)


def test_nothing_accumulates_over_a_day():
    clock = PhaseClock(PRESETS["UNIFORM"], 10.0).started(0.0)
    day = 86_400.0
    assert clock.at(day)[0][0] == pytest.approx(-math.pi / 2 + 10.0 * day, rel=1e-14)


def test_refuses_a_negative_omega():
    with pytest.raises(InputError, match="omega_rad_s"):
        PhaseClock(PRESETS["SGCS"], 8.0).with_omega(0.0, -1.0)
