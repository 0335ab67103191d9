"""Profile likelihood: what is held stays so, and a fit moves to the lowest stair."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.profile import lowest_in_profiles, profile
from sandbot_model.physics.catalogue import catalogue
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


def test_a_fit_on_the_wrong_stair_moves_to_the_lowest(drawn):
    lowest = lowest_in_profiles(fitted(drawn, "disturbed_ground", levels=7))
    s_c = lowest.model.names.index("disturbed_ground.s_c")
    theta = lowest.point.theta + 0.03 * (np.arange(len(lowest.point.theta)) == s_c)
    on_another = fitted_at(lowest.model, lowest.cells, replace(lowest.point, theta=theta))
    found = lowest_in_profiles(on_another)
    assert on_another.deviance > lowest.deviance + 5
    assert found.deviance == pytest.approx(lowest.deviance, abs=1.0)
    assert lowest_in_profiles(lowest) is lowest
