"""Means of leg periods, as they are published while a trial runs, are those the trials table is made of."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbot_tracking.period import PeriodMeans
from sandbot_tracking.trial import summarise

STAGGER = np.array([-np.pi / 2] * 3 + [np.pi / 2] * 3)


def walk(t, omega, stance=0.6, radius=0.0355):
    """x and axle height of legs that carry the body a part of every step and leave it lying for the rest."""
    step = np.floor(np.maximum(t, 0) * omega / np.pi)
    theta = np.clip((np.maximum(t, 0) * omega / np.pi - step) * np.pi - np.pi / 2, -stance, stance)
    x = radius * (2 * np.sin(stance) * step + np.sin(theta) + np.sin(stance))
    return x, 0.025 + radius * (np.cos(theta) - np.cos(stance))


def run(t, x, z, omega, angle=None):
    means = PeriodMeans()
    angle = omega * t if angle is None else angle
    rows = [means.update(*row) for row in zip(t, x, z, angle, strict=True)]
    return [one for one in rows if one is not None]


@settings(max_examples=12)
@given(st.floats(4, 30), st.floats(0, 1), st.integers(0, 2**32 - 1), st.floats(0, 2e-5))
@pytest.mark.slow
def test_live_means_are_the_tables_speed(omega, phase, seed, noise):
    rng = np.random.default_rng(seed)
    t = np.append(0.0, (np.arange(round(400 * 2 * np.pi / omega)) + 0.01 + 0.99 * phase) / 100)
    x, z = walk(t, omega)
    x = x + noise * rng.standard_normal(t.size)
    means = np.array([one.speed_m_s for one in run(t, x, z, omega)])
    leg_t = np.arange(0, t[-1] + 0.005, 0.005)
    table = summarise(t, x, z, z, leg_t, omega * leg_t[:, None] + STAGGER)
    assert len(means) >= 3
    # The same places divided by the same times; the table may end a period later.
    assert means[1:].mean() == pytest.approx(table.speed_m_s, rel=2e-3)
    # What a period is off by itself: a line of a few frames through the corner where a foot falls.
    assert means[1:] == pytest.approx(table.speed_m_s, rel=0.02)


def test_a_period_cut_at_a_late_leg_angle_would_be_off():
    """Negative control: the fault this replaces, angles 20 ms older or newer than the frame."""
    omega = 12.0
    t = np.arange(200) / 100
    x, z = walk(t, omega)
    late = omega * np.maximum(t - 0.02 * (np.arange(200) % 60 > 40), 0)
    cut, right = (np.array([one.speed_m_s for one in run(t, x, z, omega, angle)]) for angle in (late, None))
    assert np.ptp(right[1:]) < 0.01 * right[1:].mean()
    assert np.ptp(cut) > 2 * np.ptp(right[1:])


def test_a_gap_at_the_end_of_a_period_is_not_made_up():
    omega, t = 12.0, np.arange(200) / 100
    x, z = walk(t, omega)
    x[48:58] = np.nan
    means = run(t, x, z, omega)
    assert [np.isfinite(one.speed_m_s) for one in means] == [False, False, True]
    assert all(np.isfinite(one.lift_m) for one in means)
    assert run(t, x, z, 0.0) == []
