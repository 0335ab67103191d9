"""Error bars of a figure as pure error: those of rows that stand for a condition, never those of single trials."""

import numpy as np
import pytest

from sandbot_model.data.pure_error import PureError
from sandbot_model.data.stated_error import TRIALS_BEHIND, stated_variance, with_stated
from sandbot_model.physics.observables import Observable

NAN = float("nan")


def error(dof):
    return PureError(
        covariance=np.tile(np.eye(4) * 1e-4, (2, 1, 1)), sd=np.full(4, 1e-2), dof=np.array(dof), own=np.zeros(2, bool)
    )


def test_a_row_without_a_replicate_number_states_its_error_and_a_trial_does_not():
    columns = np.array([[NAN, 1.0, NAN, NAN], [0.01, 0.01, NAN, 0.02], [NAN, NAN, 0.001, 0.002]])
    found = stated_variance(columns, np.array([3.0, 3.0, 3.0, 3.0]))
    np.testing.assert_allclose(found, [0.01**2, NAN, NAN, 0.02**2 + (3.0 * 0.002) ** 2])


def test_error_bars_are_the_pure_error_where_nothing_was_repeated():
    found = with_stated(error([0, 0, 0, 0]), np.array([0.02**2, NAN]))
    assert found.covariance[:, Observable.speed, Observable.speed] == pytest.approx([0.02**2, 0.02**2])
    assert found.sd[Observable.speed] == pytest.approx(0.02)
    assert found.dof.tolist() == [TRIALS_BEHIND - 1, 0, 0, 0]
    assert found.covariance[:, Observable.lift, Observable.lift] == pytest.approx(1e-4)


def test_replicates_go_before_error_bars():
    replicated, nothing = error([6, 6, 6, 6]), error([0, 0, 0, 0])
    assert with_stated(replicated, np.array([0.02**2, 0.02**2])) is replicated
    assert with_stated(nothing, np.array([NAN, NAN])) is nothing


def test_how_a_speed_with_an_error_bar_goes_with_what_was_repeated_is_taken_for_nothing():
    """A condition's mean, copied into the row of each of its trials: with it the whole fit came to NaN."""
    copied = error([0, 4, 4, 4])
    copied.covariance[:, Observable.speed] = copied.covariance[..., Observable.speed] = NAN
    found = with_stated(copied, np.array([0.02**2, 0.02**2])).covariance
    np.testing.assert_allclose(found, np.tile(np.diag([0.02**2, 1e-4, 1e-4, 1e-4]), (2, 1, 1)))
