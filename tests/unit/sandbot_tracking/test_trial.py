"""Observables of simulated walking (stance x = R sin, with its jumps of speed) and swimming."""

import math
import re

import numpy as np
import pytest

from sandbot_clock.gait import PRESETS, leg_angles
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_tracking import fold, folded_peak, trial
from sandbot_tracking.fold import NotMeasured
from sandbot_tracking.trial import never_measured, summarise

R, H = 0.0355, 0.025


def legs(omega, duration):
    t = np.arange(-0.2, duration, 0.005)
    turn = omega * np.maximum(t, 0.0)[:, None]
    return t, (turn - np.pi / 2 + np.array([0.0] * 3 + [np.pi] * 3)) % (2 * np.pi)


def walk(t, omega, ratio):
    alpha, phase = np.arcsin(ratio / 2), np.maximum(t, 0) * omega / np.pi
    step = np.floor(phase)
    theta = np.clip((phase - step) * np.pi - np.pi / 2, -alpha, alpha)
    return step * ratio * R + R * (np.sin(theta) + np.sin(alpha)), H + R * (np.cos(theta) - np.cos(alpha))


def measure(rng, x, z, t, omega, noise=3e-5):
    x, front, rear = (values + noise * rng.standard_normal(t.size) for values in (x, z, z))
    return summarise(t, x, front, rear, *legs(omega, t[-1] + 0.1))


@pytest.mark.parametrize("omega", [4.0, 16.0, 30.0])
@pytest.mark.parametrize("ratio", [0.3, 0.9, 1.6])
def test_walking_is_measured_to_its_stated_accuracy(rng, omega, ratio):
    t = np.arange(-0.1, max(3.0, 8 * np.pi / omega), 0.01) + rng.uniform(0, 0.01)
    x, z = walk(t, omega, ratio)
    summary = measure(rng, x, z, t, omega)
    assert summary.reason == ""
    assert summary.speed_m_s == pytest.approx(omega * ratio * R / np.pi, rel=0.002)
    assert summary.peak_speed_m_s == pytest.approx(R * omega, rel=0.015)
    assert summary.lift_m == pytest.approx(R * (1 - np.cos(np.arcsin(ratio / 2))), abs=1e-4)
    assert summary.first_step_m == pytest.approx(ratio * R, abs=2e-4)


def test_steps_of_whole_frames_are_measured_or_refused(rng):
    """ω = 10π: ten frames a step, all steps at the same ten phases."""
    t = np.arange(-0.1, 3.0, 0.01)
    for ratio in (0.3, 0.9, 1.6):
        x, z = walk(t, 10 * np.pi, ratio)
        summary = measure(rng, x, z, t, 10 * np.pi)
        assert summary.speed_m_s == pytest.approx(10 * ratio * R, rel=0.002)
        if np.isnan(summary.peak_speed_m_s):
            assert "peak speed: " in summary.reason
        else:
            assert summary.peak_speed_m_s == pytest.approx(10 * np.pi * R, rel=0.1)


@pytest.mark.parametrize("omega", [6.0, 14.0, 24.0])
@pytest.mark.parametrize("periods", [0.4, 1.9, 2.1, 3.1, 4.1])
def test_what_a_trial_is_too_short_for_is_known_before_it_is_run(rng, omega, periods):
    t = np.arange(-0.1, periods * 2 * np.pi / omega, 0.01)
    x, z = walk(t, omega, 0.9)
    leg_t, angle = legs(omega, t[-1])
    summary = summarise(t, x, z, z, leg_t, angle)
    lost = never_measured(leg_t[leg_t >= 0], angle[leg_t >= 0], 100.0)
    assert [name for name in lost if np.isfinite(getattr(summary, name))] == []
    assert ("speed_m_s" in lost) == np.isnan(summary.speed_m_s) == (periods < 2)
    assert ("first_step_m" in lost) == np.isnan(summary.first_step_m) == (periods < 0.5)
    assert ("lift_m" in lost) == np.isnan(summary.lift_m) == (periods < (2 if omega == 6 else 3))
    # A faster camera.
    assert ("lift_m" in never_measured(leg_t, angle, 1000.0)) == (periods < 2)


def short_walks(omega, ratio, trials=12):
    """Peak speeds of short trials relative to Rω."""
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        t = np.arange(-0.1, 1.25, 0.01) + rng.uniform(0, 0.01)
        yield measure(rng, *walk(t, omega, ratio), t, omega).peak_speed_m_s / (R * omega)


@pytest.mark.parametrize("ratio", [0.6, 0.8])
def test_no_peak_is_read_from_a_curve_across_a_gap(monkeypatch, ratio):
    """13.09 frames a step: in a few steps phases come in groups, with a kink in a gap between them.

    Controls: without the limit some peaks are more than 5 % too high; at ω = 22, without gaps, it changes nothing.
    """
    groups, even = list(short_walks(24.0, ratio)), list(short_walks(22.0, ratio))
    assert groups == pytest.approx([1.0] * len(groups), abs=0.015)
    monkeypatch.setattr(folded_peak, "_MAX_GAP", np.inf)
    assert max(short_walks(24.0, ratio)) > 1.05
    assert list(short_walks(22.0, ratio)) == even


def test_one_frame_a_step_is_a_reason_and_not_a_fault(rng):
    """All frames at one phase of the step: no line and no curve goes through them, and no matrix is inverted."""
    t = np.arange(100) * 0.1
    x, z = walk(t, 10 * np.pi, 0.9)
    summary = measure(rng, x, z, t, 10 * np.pi)
    assert np.isnan(summary.peak_speed_m_s)
    assert "peak speed: the folded step is not sampled finely enough" in summary.reason


def test_a_fault_of_ours_is_not_taken_for_a_reason(rng, monkeypatch):
    def broken(*_):
        raise ValueError("a fault")

    monkeypatch.setattr(trial, "peak_slope", broken)
    t = np.arange(-0.1, 4.0, 0.01)
    with pytest.raises(ValueError, match="a fault"):
        measure(rng, *walk(t, 8.0, 0.9), t, 8.0)


@pytest.mark.parametrize("omega", [4.0, 24.0, 30.0])
def test_swimming_has_no_lift_and_no_false_peak(rng, omega):
    t = np.arange(-0.1, max(3.0, 8 * np.pi / omega), 0.01)
    summary = measure(rng, 0.02 * np.maximum(t, 0), np.full(t.size, H), t, omega, 1e-4)
    assert summary.peak_speed_m_s == pytest.approx(0.02, rel=0.1)
    assert summary.speed_m_s == pytest.approx(0.02, rel=0.02)
    assert abs(summary.lift_m) < 5e-5


def test_swimming_of_a_short_trial_has_no_false_peak():
    # 13.09 frames a step: neighbours in phase are neighbours in time, so they share their step's error of rest.
    t = np.arange(-0.1, 1.95, 0.01)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        summary = measure(rng, 0.03 * np.maximum(t, 0), np.full(t.size, H), t, 24.0)
        assert summary.peak_speed_m_s == pytest.approx(0.03, rel=0.1)


def test_gaps_are_counted_and_do_not_bias(rng):
    t = np.arange(-0.1, 3.0, 0.01)
    x, z = walk(t, 16.0, 1.0)
    x[50:60] = np.nan
    summary = measure(rng, x, z, t, 16.0)
    assert summary.gaps == 10
    assert summary.peak_speed_m_s == pytest.approx(16 * R, rel=0.015)


def test_what_cannot_be_measured_is_nan_with_a_reason(rng):
    t = np.arange(-0.1, 0.5, 0.01)
    x, z = walk(t, 8.0, 1.0)
    short = measure(rng, x, z, t, 8.0)
    assert np.isnan([short.speed_m_s, short.peak_speed_m_s, short.lift_m]).all()
    assert "period" in short.reason
    assert short.first_step_m == pytest.approx(R, abs=3e-4)
    still = summarise(t, x, z, z, t, np.zeros((t.size, 6)))
    assert np.isnan(still.first_step_m)
    assert "less than a step" in still.reason


def stance(name, omega, t, alpha, mount):
    """Leg angles (n, 6) of a gait, and x of a body that each leg carries from -alpha to alpha about straight below.

    The body is set down at rest: a leg that is in mid-stance then carries it from its next stance on.
    """
    angle = leg_angles(PRESETS[name], omega, np.maximum(t, 0.0))[0]
    theta = angle[:, [0, 3]] + mount
    steps = np.floor((theta + np.pi) / (2 * np.pi))
    part = np.where(steps < 0, -alpha, np.clip(theta - 2 * np.pi * steps, -alpha, alpha))
    steps = np.maximum(steps, 0)
    x = R * (2 * np.sin(alpha) * steps + np.sin(part)).sum(axis=1)
    return angle, x - x[0]


@pytest.mark.parametrize("omega", [4.0, 12.0, 20.0, 30.0])
@pytest.mark.parametrize(("name", "mount", "alpha"), [("SGCS", 0.0, 0.72), ("SGCS", 0.5, 0.5), ("UNIFORM", 0.0, 0.9)])
def test_the_first_step_is_counted_to_rest_whatever_the_gait(omega, name, mount, alpha):
    """SGCS without a mount carries its body on past half a period, to less than a frame before the handover."""
    for shift in (0.0, 0.003, 0.007):
        t = np.arange(-0.1, 3.5, 0.01) + shift
        x = stance(name, omega, t, alpha, mount)[1]
        legs_t = np.arange(-0.2, 3.6, 0.005)
        angle = stance(name, omega, legs_t, alpha, mount)[0] % (2 * np.pi)
        z = np.full(t.size, H)
        found = summarise(t, x, z, z, legs_t, angle, robot=Robot(leg_mount_rad=mount))
        assert found.first_step_m == pytest.approx(2 * R * np.sin(alpha), abs=2e-4)
        assert found.speed_m_s == pytest.approx(omega / np.pi * 2 * R * np.sin(alpha), rel=2e-3)


def test_legs_that_start_within_a_step_make_no_first_step():
    """Encoders with another zero than straight below: what is counted in steps is as it was, the first is not."""
    t = np.arange(-0.1, 3.5, 0.01)
    legs_t = np.arange(-0.2, 3.6, 0.005)
    x, z = stance("UNIFORM", 8.0, t, 0.6, 0.0)[1], np.full(t.size, H)
    angle = stance("UNIFORM", 8.0, legs_t, 0.6, 0.0)[0]
    right, wrong = (summarise(t, x, z, z, legs_t, angle + zero) for zero in (0.5, np.pi / 2))
    assert right.first_step_m == pytest.approx(2 * R * np.sin(0.6), abs=2e-4)
    assert np.isnan(wrong.first_step_m)
    assert "is leg_mount_rad right?" in wrong.reason
    assert wrong.speed_m_s == pytest.approx(right.speed_m_s, rel=1e-3)


def test_a_swimmer_s_first_step_ends_with_the_clock(rng):
    """Control: a body that never rests is read at the handover, not where it happens to be slowest."""
    t = np.arange(-0.1, 3.0, 0.01)
    found = [measure(rng, 0.02 * np.maximum(t, 0), np.full(t.size, H), t, 8.0).first_step_m for _ in range(40)]
    assert np.mean(found) == pytest.approx(0.02 * np.pi / 8.0, abs=3e-5)
    assert np.std(found) < 8e-5


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="shapes"):
        summarise(np.arange(5.0), np.zeros(4), np.zeros(5), np.zeros(5), np.arange(5.0), np.zeros((5, 6)))


@pytest.mark.parametrize(
    ("peak", "speed", "lift", "resolved"),
    [
        (0.57, 0.2, 0.006, True),
        (0.14, 0.007, 0.0003, True),
        (0.0302, 0.03, 0.0, True),
        (0.46, 0.0195, 0.0, False),
        (-0.0007, 0.0108, 0.0003, False),
        (0.57, 0.2, math.nan, True),
    ],
)
def test_a_peak_is_kept_only_where_the_body_can_have_reached_it(peak, speed, lift, resolved):
    if resolved:
        assert trial._plausible(peak, speed, lift) == peak
    else:
        with pytest.raises(NotMeasured, match="m/s at a mean of"):
            trial._plausible(peak, speed, lift)


@pytest.mark.parametrize(("omega", "alpha", "resolved"), [(8.0, 0.44, True), (4.0, 0.44, True), (16.0, 0.2, False)])
def test_a_fast_end_of_a_stance_is_seen_or_the_peak_is_not_measured(rng, omega, alpha, resolved):
    """SGCS: slow up to 0.05 rad, then 1.5 times the mean rate; 32, 65 and 6 ms of a stance are fast here.

    Of what lasts less than a frame a third may be missing; it must never be the slow part's βRω, a quarter of it.
    """
    fast = 1.5 * R * omega
    for _ in range(4):
        t = np.arange(-0.1, 8 * np.pi / omega, 0.01) + rng.uniform(0, 0.01)
        legs_t = np.arange(-0.2, t[-1] + 0.1, 0.005)
        x, z = stance("SGCS", omega, t, alpha, 0.0)[1], np.full(t.size, H) + 0.002 * (t > 0)
        x, z = (values + 5e-5 * rng.standard_normal(t.size) for values in (x, z))
        found = summarise(t, x, z, z, legs_t, stance("SGCS", omega, legs_t, alpha, 0.0)[0])
        if resolved:
            assert found.peak_speed_m_s == pytest.approx(fast, rel=0.1)
        elif np.isnan(found.peak_speed_m_s):
            assert "too short to resolve" in found.reason
        else:
            assert found.peak_speed_m_s == pytest.approx(fast, rel=0.35)


def filmed_by(rate, rng, omega=8.0, ratio=0.9, steps=12):
    """A walk filmed by a camera whose clock runs fast by a share ``rate`` from the start on."""
    t = np.arange(-0.1, steps * np.pi / omega, 0.01) + rng.uniform(0, 0.01)
    x, z = walk(t, omega, ratio)
    return measure(rng, x, z, np.where(t > 0, t * (1 + rate), t), omega)


@pytest.mark.parametrize("rate", [-0.03, -0.01, -0.002, 0.002, 0.005, 0.01, 0.03])
def test_a_camera_s_clock_of_another_rate_than_the_legs_gives_no_lift_and_no_peak(rng, rate):
    """Else the steep parts of the fold are refused as no noise, and the flat part between two steps is the top: 0."""
    found = filmed_by(rate, rng)
    assert np.isnan([found.lift_m, found.peak_speed_m_s]).all()
    said = re.findall(r"(lift|peak speed): the film's steps last (\S+) ±", found.reason)
    assert [(what, float(percent)) for what, percent in said] == [
        (what, pytest.approx(100 * abs(rate), rel=0.05)) for what in ("lift", "peak speed")
    ]
    assert ("longer" in found.reason) is (rate > 0)
    assert found.speed_m_s == pytest.approx(8 * 0.9 * R / np.pi, rel=0.02)


@pytest.mark.parametrize("rate", [-1e-4, 0.0, 1e-4])
@pytest.mark.parametrize("omega", [4.0, 8.0, 24.0])
def test_a_clock_within_what_clocks_drift_is_none_of_them(rng, rate, omega):
    found = filmed_by(rate, rng, omega)
    assert found.reason == ""
    assert found.lift_m == pytest.approx(R * (1 - np.cos(np.arcsin(0.45))), abs=1e-4)
    assert found.peak_speed_m_s == pytest.approx(R * omega, rel=0.03)


def test_the_flat_part_of_a_step_is_not_taken_for_its_top(rng, monkeypatch):
    """Whatever makes steps not fold. Control: those that do keep their lift."""
    monkeypatch.setattr(fold, "_MIN_STEPS", np.inf)
    assert "lift: a top too short to resolve (" in filmed_by(0.0075, rng, steps=24).reason
    assert filmed_by(0.0, rng, steps=24).reason == ""


def test_steps_that_are_only_irregular_blame_no_clock(rng):
    """Phases that scatter, as of a lift that is mostly noise, have a slope by chance."""
    number = np.arange(0.0, 10.0, 0.05) + 1e-9
    for _ in range(200):
        late = np.repeat(rng.uniform(-0.5, 0.5, 10), 20)
        fold.check_in_step(number, np.sin(np.pi * (number % 1.0)) ** 2 * np.cos(2 * np.pi * (number - late)))
    with pytest.raises(NotMeasured, match=r"1\.01 ± .* % longer"):
        fold.check_in_step(number, np.sin(np.pi * (0.99 * number % 1.0)) ** 4)


@pytest.mark.parametrize("rests", [[0.0, np.nan, 0.1, np.nan], [0.0, 0.05, 0.1, 0.15]])
def test_a_film_in_which_no_step_has_both_its_ends_has_no_peak_and_no_warning(rests):
    t_s = np.linspace(0.0, 3.0, 300)
    if np.isfinite(rests).all():
        assert folded_peak.peak_slope(t_s, 0.05 * t_s, np.arange(4.0), np.array(rests)) == pytest.approx(0.05)
        return
    with pytest.raises(NotMeasured, match="0 frames in steady steps"):
        folded_peak.peak_slope(t_s, 0.05 * t_s, np.arange(4.0), np.array(rests))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_trial_without_frames_is_no_warning_of_numpy(count):
    """A tracker that saw nothing had three lines of numpy printed by the campaign, before the reason."""
    t = np.arange(count) * 0.01
    summary = summarise(t, 0 * t, 0 * t, 0 * t, *legs(8.0, 4.0))
    assert math.isnan(summary.speed_m_s)
    assert (summary.reason == "no frames") is (count < 2)
    assert summary.reason
