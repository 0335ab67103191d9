import numpy as np
import pytest
import scipy  # not scipy.stats, which takes a second to import: it does that by itself where it is used
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.data.distributions import chi2_ppf, chi2_sf, f_isf, f_sf, t_sf

DOF = st.integers(1, 200)
VALUES = st.floats(0.0, 1e4)


@given(value=VALUES, dof=DOF, error_dof=DOF)
def test_tails_are_those_of_scipy_stats_to_the_digit(value, dof, error_dof):
    assert chi2_sf(value, dof) == scipy.stats.chi2.sf(value, dof)
    assert t_sf(value, dof) == scipy.stats.t.sf(value, dof)
    assert f_sf(value, dof, error_dof) == scipy.stats.f.sf(value, dof, error_dof)


@given(tail=st.floats(1e-12, 1.0), error_dof=DOF)
def test_the_value_above_which_a_tail_lies(tail, error_dof):
    assert f_isf(tail, 1, error_dof) == scipy.stats.f.isf(tail, 1, error_dof)


@given(probability=st.floats(0.0, 1.0), dof=DOF)
def test_the_value_below_which_chi2_lies(probability, dof):
    assert chi2_ppf(probability, dof) == scipy.stats.chi2.ppf(probability, dof)


@pytest.mark.parametrize("value", [0.0, np.inf, np.nan])
def test_ends_and_gaps(value):
    np.testing.assert_equal(chi2_sf(value, 3), scipy.stats.chi2.sf(value, 3))
    np.testing.assert_equal(f_sf(value, 3, 5), scipy.stats.f.sf(value, 3, 5))


def test_arrays_go_through_at_once():
    values, dof = np.array([1.0, 2.0]), np.array([1, 4])
    np.testing.assert_array_equal(chi2_sf(values, dof), scipy.stats.chi2.sf(values, dof))
