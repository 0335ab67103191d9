"""v_x(t) against known truth: rms error, honest variance, gaps, a walk that turns into swimming."""

import numpy as np
import pytest

from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_tracking import speed
from sandbot_tracking.calibration import read_cameras
from sandbot_tracking.live import warm_up
from sandbot_tracking.smooth import smooth
from sandbot_tracking.speed import HarmonicSpeed

T = np.arange(0, 5, 0.01)
W = 10 * np.pi
X, V = 0.20 * T - 0.05 * np.cos(W * T) / W, 0.2 + 0.05 * np.sin(W * T)


def online(x, noise, omega=W / 2):
    filter_ = HarmonicSpeed()
    return np.array([filter_.update(t, value, noise**2, omega) for t, value in zip(T, x, strict=True)]), filter_


def test_the_smoother_halves_the_error_of_differences(rng):
    x = X + 6e-5 * rng.standard_normal(T.size)
    found = smooth(T, x)
    error = found.v - V
    assert np.sqrt(np.mean(error**2)) < 0.55 * np.sqrt(np.mean((np.gradient(x, T) - V) ** 2))
    assert np.mean(error**2 / found.var) < 2


@pytest.mark.parametrize(("noise", "tuned"), [(2e-5, 0.00043), (6e-5, 0.00101), (5e-4, 0.00539)])
def test_the_smoother_finds_the_period_by_itself(rng, noise, tuned):
    """``tuned``: an integrated-noise smoother tuned to this very truth [m/s]."""
    found = smooth(T, X + noise * rng.standard_normal(T.size))
    assert np.sqrt(np.mean((found.v - V) ** 2)) < 0.8 * tuned
    assert 0.3 < np.mean((found.v - V) ** 2 / found.var) < 2.5


def test_kinks_are_no_noise(rng):
    """A body carried for a third of each step has more harmonics than ours: its variance must stay honest."""
    phase = 30.0 * T / np.pi
    theta = np.clip((phase % 1.0) * np.pi - np.pi / 2, -0.5, 0.5)
    x = 0.0355 * (2 * np.sin(0.5) * np.floor(phase) + np.sin(theta))
    v = np.where(np.abs(theta) < 0.5, 0.0355 * 30.0 * np.cos(theta), 0.0)
    found = smooth(T, x + 5e-5 * rng.standard_normal(T.size))
    assert np.mean((found.v - v)[5:-5] ** 2 / found.var[5:-5]) < 2


def test_uneven_frames_have_no_spectrum_and_are_smoothed_all_the_same(rng):
    uneven = np.sort(T + 0.002 * rng.uniform(-1, 1, T.size))
    x = 0.2 * uneven - 0.05 * np.cos(W * uneven) / W
    found = smooth(uneven, x + 6e-5 * rng.standard_normal(T.size))
    assert np.sqrt(np.mean((found.v - 0.2 - 0.05 * np.sin(W * uneven)) ** 2)) < 0.003


def test_the_clock_locked_filter_has_no_lag(rng):
    x = X + 6e-5 * rng.standard_normal(T.size)
    v, var = online(x, 6e-5)[0][200:].T
    assert np.sqrt(np.mean((v - V[200:]) ** 2)) < 0.0009
    assert np.mean((v - V[200:]) ** 2 / var) < 1.5
    wrong = online(x, 6e-5, omega=1.3 * W / 2)[0][200:, 0]
    assert np.sqrt(np.mean((wrong - V[200:]) ** 2)) > 0.0018


def test_variance_stays_honest_when_walking_turns_into_swimming(rng):
    change = 250
    v_true = np.where(np.arange(T.size) < change, V, 0.02)
    x = np.where(np.arange(T.size) < change, X, X[change] + 0.02 * (T - T[change]))
    v, var = online(x + 6e-5 * rng.standard_normal(T.size), 6e-5)[0].T
    off = (v - v_true) ** 2
    assert var[change + 1 : change + 4].max() > 5 * var[change - 1]
    assert np.mean(off[change + 2 :] / var[change + 2 :]) < 3
    assert np.sqrt(off[change + 20 :].mean()) < 0.01


def test_gaps_are_nan_and_counted(rng):
    x = X + 6e-5 * rng.standard_normal(T.size)
    x[100:110] = np.nan
    found = smooth(T, x)
    assert found.gaps == 10
    assert np.isnan(found.v[100:110]).all()
    assert np.isfinite(np.delete(found.v, np.s_[100:110])).all()
    speeds, filter_ = online(x, 6e-5)
    assert filter_.gaps == 10
    assert np.isnan(speeds[100:110]).all()


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="grow"):
        smooth(T[::-1], X)
    with pytest.raises(InputError, match="at least 8"):
        smooth(T[:5], X[:5])
    filter_ = HarmonicSpeed()
    filter_.update(1.0, 0.0, 1e-9)
    with pytest.raises(InputError, match="after"):
        filter_.update(1.0, 0.0, 1e-9)


def test_the_filter_is_compiled_before_the_first_frame(monkeypatch):
    from_frames = []
    monkeypatch.setattr(speed, "_imm", lambda *given: from_frames.append(tuple(map(type, given))) or (0.0, 0.0))
    online(X, 6e-5)
    kinds = set(from_frames)
    from_frames.clear()
    warm_up(read_cameras(config_file("cameras.yaml")))
    assert set(from_frames) == kinds
