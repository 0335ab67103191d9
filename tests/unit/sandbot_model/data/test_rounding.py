"""The step to which numbers were rounded is found, and means of replicates are no surer than it lets them be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.data.conditions import cells_of
from sandbot_model.data.rounding import rounding_sd, rounding_step, shared_rounding_variance
from sandbot_model.discovery.compare import compare
from sandbot_record.trials.read import read


@given(st.sampled_from([0.01, 0.005, 1e-3, 1e-4]), st.integers(0, 2**32 - 1))
def test_the_step_is_found_and_none_where_nothing_was_rounded(step, seed):
    exact = np.random.default_rng(seed).uniform(0.0, 0.2, 60)
    assert rounding_step(exact) == 0.0
    few = np.append(exact[:20] * step * 100, np.nan)  # within a few steps of each other
    assert rounding_step(np.round(few / step) * step) in (0.0, pytest.approx(step))
    assert rounding_step(np.arange(10) * step) == pytest.approx(step)
    assert rounding_step(np.arange(5) * step) == 0.0


@pytest.mark.parametrize("scatter", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_means_of_rounded_replicates_are_off_by_what_is_said(scatter, count):
    """Against 200 000 means of numbers rounded to 1."""
    rng = np.random.default_rng(1)
    true = rng.uniform(0, 1, (200_000, 1))
    rounded = np.round(true + scatter * rng.normal(size=(200_000, count)))
    off = np.var(rounded.mean(axis=1) - true[:, 0])
    one = np.array([[scatter**2 + 1 / 12]])
    said = one / count + shared_rounding_variance(np.array([1 / np.sqrt(12)]), one, np.array([[count]]))
    assert said[0, 0] == pytest.approx(off, rel=0.02)


def test_numbers_that_were_not_rounded_are_as_they_were():
    exact = np.random.default_rng(2).normal(size=(50, 4))
    assert rounding_sd(exact).tolist() == [0.0] * 4
    assert not shared_rounding_variance(np.zeros(4), np.ones((3, 4)), np.full((3, 4), 3)).any()
    no_replicates = np.full((3, 4), np.nan)
    assert not shared_rounding_variance(np.ones(4), no_replicates, np.ones((3, 4), dtype=int)).any()


def test_a_true_model_is_not_refused_because_replicates_are_rounded_alike():
    """To 1 cm/s, with a scatter of half of that, most pairs agree: taken for exact they gave p = 3e-107."""
    shown = read(Path(__file__).parents[4] / "examples" / "demo_trials.csv")
    pairs = shown.select(shown.replicate <= 2)
    nothing = np.full(len(pairs), np.nan)
    told = np.array([0.58, 0.59, 0.6, 0.616, 0.633])  # to the bed, whose φ as it was measured no two trials share
    level = told[np.abs(pairs.phi[:, None] - told).argmin(axis=1)]
    speed_alone = {"speed_sd_m_s": nothing, "lift_m": nothing, "peak_speed_m_s": nothing, "first_step_m": nothing}
    exact = replace(pairs, phi=level, phi_sd=nothing, **speed_alone)
    rounded = replace(exact, speed_m_s=np.round(exact.speed_m_s, 2))
    assert lack_of_fit_p(rounded) == pytest.approx(lack_of_fit_p(exact), abs=0.2)


def test_a_wrong_model_is_refused_though_readings_are_rounded():
    """Control: with the lift an effect is seen, to 1 mm as well."""
    shown = read(Path(__file__).parents[4] / "examples" / "demo_trials.csv")
    rounded = replace(shown, speed_m_s=np.round(shown.speed_m_s, 2), lift_m=np.round(shown.lift_m, 3))
    assert lack_of_fit_p(shown) < 1e-9
    assert lack_of_fit_p(rounded) < 1e-6


def lack_of_fit_p(trials):
    return compare(cells_of(trials), {}).steps[0].lack_of_fit_p
