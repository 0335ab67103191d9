"""Profile likelihood: a parabola's width, and an error where a derivative knows none."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting import profile as profile_module
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.profile import _over_grid, deepest, profile, with_profiled_errors
from sandbot_model.fitting.walked import walked
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of


def fitted(drawn, name, **more):
    return fit(model_of("simple", (name,), catalogue()), cells_of(drawn((name,), seed=2, **more)))


def test_a_profile_holds_its_parameter_and_fits_the_others(drawn):
    smooth = fitted(drawn, "phi_dependent_response")
    at = smooth.model.names.index("phi_dependent_response.b")
    b, error = smooth.parameters["phi_dependent_response.b"]
    values = b + error * np.array([-5.0, 0.0, 5.0])
    states = profile(smooth.problem, smooth.state, [at], values[:, None])
    np.testing.assert_array_equal(states.theta[:, at], values)
    theta = np.repeat(smooth.state.theta, 3, axis=0)
    theta[:, at] = values
    rows = np.zeros(3, dtype=int)
    unadjusted = smooth.problem.states(theta, smooth.state.ln_k[rows], smooth.state.slope[rows]).deviance
    assert states.deviance[1] == pytest.approx(smooth.deviance, abs=0.1)
    assert (states.deviance[[0, 2]] > smooth.deviance + 3).all()
    assert (states.deviance[[0, 2]] < unadjusted[[0, 2]] - 10).all()


def test_a_threshold_has_an_error_that_spans_its_stair(drawn):
    stairs = fitted(drawn, "disturbed_ground", levels=7)
    at = stairs.model.names.index("disturbed_ground.s_c")
    assert np.isnan(stairs.stderr[at])
    profiled = with_profiled_errors(stairs)
    s_c = profiled.parameters["disturbed_ground.s_c"]
    assert 0.005 < s_c.stderr < 0.1
    assert s_c.value == pytest.approx(0.95, abs=3 * s_c.stderr)


def test_a_grid_that_grows_keeps_what_it_knows(drawn):
    """What was known stands in its place, however low; what is new is what a grid made at once has there."""
    smooth = fitted(drawn, "phi_dependent_response")
    at, start = [smooth.model.names.index("phi_dependent_response.b")], smooth.state
    b, error = smooth.parameters["phi_dependent_response.b"]
    axis = b + error * np.arange(-3.0, 4.0)
    known = _over_grid(smooth.problem, smooth, [axis[1:-1]], at)
    grown = _over_grid(smooth.problem, smooth, [axis], at, known)
    np.testing.assert_array_equal(grown.theta[:, at[0]], axis)
    np.testing.assert_array_equal(grown.deviance[1:-1], known.deviance)
    at_once = _over_grid(smooth.problem, smooth, [axis], at).deviance
    np.testing.assert_allclose(grown.deviance, at_once, atol=0.02)
    assert grown.deviance.min() == pytest.approx(start.deviance[0], abs=0.02)


def test_an_effect_of_many_parameters_is_profiled_one_by_one(drawn, monkeypatch):
    """A grid over all four took 18 minutes and 9 GB of a dilation in a shape of its own."""
    hump = (
        "hump: strength: k *= 1 + a*exp(-((ω - b)/c)**2)*(1 - q*first); "
        "a [1] in 0..0.3; b [rad/s] in 4..30; c [rad/s] in 1..20; q [1] in 0..1"
    )
    model = model_of("simple", ("hump",), {"hump": formula_effect(hump)})
    unseen = fit(model, cells_of(drawn(seed=2)))
    alone = []
    monkeypatch.setattr(profile_module, "walked", lambda *given: alone.append(given[2]) or walked(*given))
    monkeypatch.setattr(profile_module, "_gone_over", None)
    own = [index for index, name in enumerate(model.names) if name.startswith("hump.")]
    assert len(own) == 4
    stderr = unseen.stderr.copy()
    stderr[own[1:]] = np.nan
    profiled = with_profiled_errors(replace(unseen, stderr=stderr))
    assert set(own) <= set(alone)
    assert (profiled.stderr[own] > 0).all()


def test_a_fit_without_stairs_stays_as_it_is(drawn):
    smooth = fitted(drawn, "motor_saturation")
    assert with_profiled_errors(smooth) is smooth


def test_an_error_as_wide_as_the_range_is_profiled_within_the_range(drawn):
    """Eight standard errors away the deviance is anything, and only the fit itself would count."""
    stairs = fitted(drawn, "disturbed_ground", levels=7)
    at = stairs.model.names.index("disturbed_ground.k_l_n_per_m")
    wide = replace(stairs, stderr=np.where(np.arange(len(stairs.stderr)) == at, 1e3, stairs.stderr))
    assert 0.01 < with_profiled_errors(wide).stderr[at] < 10.0


def test_the_curvature_at_the_brink_of_a_cliff_is_no_error(drawn):
    """Where a cell comes to walk a derivative is anything, and may say that a parameter is known to a millionth."""
    stairs = fitted(drawn, "disturbed_ground", levels=7)
    at = stairs.model.names.index("disturbed_ground.k_l_n_per_m")
    sharp = replace(stairs, stderr=np.where(np.arange(len(stairs.stderr)) == at, 1e-4, stairs.stderr))
    usual = with_profiled_errors(stairs).stderr[at]
    assert with_profiled_errors(sharp).stderr[at] == pytest.approx(usual, rel=0.5)


def test_a_fit_on_the_wrong_stair_moves_to_the_lowest(drawn):
    lowest = deepest(fitted(drawn, "disturbed_ground", levels=7))
    s_c = lowest.model.names.index("disturbed_ground.s_c")
    theta = lowest.point.theta + 0.03 * (np.arange(len(lowest.point.theta)) == s_c)
    on_another = fitted_at(lowest.model, lowest.cells, replace(lowest.point, theta=theta))
    found = deepest(on_another)
    assert on_another.deviance > lowest.deviance + 5
    assert found.deviance == pytest.approx(lowest.deviance, abs=1.0)
    assert deepest(lowest) is lowest
