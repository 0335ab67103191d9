"""Standard errors: a parabola's where there is one, those of a sample across stairs and cliffs."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit, fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of


@pytest.fixture(scope="module")
def stairs(drawn) -> Fit:
    return fit(model_of("simple", ("disturbed_ground",), catalogue()), cells_of(drawn(("disturbed_ground",), seed=2)))


def with_error(found: Fit, index: int, error: float) -> Fit:
    return replace(found, stderr=np.where(np.arange(len(found.stderr)) == index, error, found.stderr))


def test_a_fit_without_stairs_stays_as_it_is(smooth):
    assert with_sampled_errors(smooth) is smooth


def test_a_threshold_has_an_error_that_spans_its_stair(stairs):
    at = stairs.model.names.index("disturbed_ground.s_c")
    assert np.isnan(stairs.stderr[at])
    sampled = with_sampled_errors(stairs)
    s_c = sampled.parameters["disturbed_ground.s_c"]
    assert 0.005 < s_c.stderr < 0.1
    assert s_c.value == pytest.approx(0.95, abs=3 * s_c.stderr)


def test_errors_and_covariance_say_the_same(stairs):
    sampled = with_sampled_errors(stairs)
    known = np.isfinite(sampled.stderr)
    np.testing.assert_allclose(np.sqrt(np.diag(sampled.covariance))[known], sampled.stderr[known])
    assert (np.linalg.eigvalsh(sampled.covariance) > -1e-9).all()


def test_an_error_as_wide_as_the_range_is_found_within_the_range(stairs):
    at = stairs.model.names.index("disturbed_ground.k_l_n_per_m")
    assert 0.01 < with_sampled_errors(with_error(stairs, at, 1e3)).stderr[at] < 10.0


def test_the_curvature_at_the_brink_of_a_cliff_is_no_error(stairs):
    """Where a cell comes to walk a derivative is anything, and may say that a parameter is known to a millionth."""
    at = stairs.model.names.index("disturbed_ground.k_l_n_per_m")
    usual = with_sampled_errors(stairs).stderr[at]
    assert with_sampled_errors(with_error(stairs, at, 1e-4)).stderr[at] == pytest.approx(usual, rel=0.5)


def test_k_of_a_level_at_the_brink_of_a_stair_is_known_no_better_than_the_stair(drawn):
    """At φ 0.58 a condition is about to walk: by curvature its k is known to 0.05 %."""
    model = model_of("simple", ("motor_saturation",), catalogue())
    at_a_brink = fit(model, cells_of(drawn(("motor_saturation",), seed=2)))
    found, level = with_sampled_errors(at_a_brink), len(model.names)
    assert at_a_brink.stderr[level] < 1e-3
    assert 3e-3 < found.stderr[level] < 2e-2
    np.testing.assert_array_equal(np.delete(found.stderr, level), np.delete(at_a_brink.stderr, level))


def test_an_effect_of_many_parameters_has_errors(drawn):
    """A grid over all four took 18 minutes and 9 GB of a dilation in a shape of its own."""
    hump = (
        "hump: strength: k *= 1 + a*exp(-((ω - b)/c)**2)*(1 - q*first); "
        "a [1] in 0..0.3; b [rad/s] in 4..30; c [rad/s] in 1..20; q [1] in 0..1"
    )
    model = model_of("simple", ("hump",), {"hump": formula_effect(hump)})
    unseen = fit(model, cells_of(drawn(seed=2)))
    own = [index for index, name in enumerate(model.names) if name.startswith("hump.")]
    stderr = unseen.stderr.copy()
    stderr[own[1:]] = np.nan
    found = with_sampled_errors(replace(unseen, stderr=stderr)).stderr[own]
    width = np.array([model.parameters[index].width for index in own])
    assert (found > 0).all()
    assert (found < width).all()
