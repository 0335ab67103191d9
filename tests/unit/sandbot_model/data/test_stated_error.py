"""Error bars of a figure as pure error: those of rows that stand for a condition, never those of single trials."""

import numpy as np
import pytest

from sandbot_model.data.distributions import f_sf
from sandbot_model.data.pure_error import PureError
from sandbot_model.data.stated_error import COLUMNS, TRIALS_BEHIND, of_single_trials, stated_bars, with_stated
from sandbot_model.physics.observables import Observable

NAN = float("nan")
USUAL = np.array([5e-3, 5e-4, 1e-2, 1.5e-3])


def error(dof, cells=2):
    covariance = np.tile(np.eye(4) * 1e-4, (cells, 1, 1))
    return PureError(covariance, sd=np.full(4, 1e-2), dof=np.array(dof), own=np.zeros(cells, bool))


def bars(slope=0.0, **columns):
    """What the columns state, all of one length; NaN where not given."""
    n = len(next(iter(columns.values())))
    return stated_bars(np.array([columns.get(name, np.full(n, NAN)) for name in COLUMNS]), np.full(n, slope))


def pooled(stated, omega=None):
    """Variance of the speed of each row, and the pure error."""
    cells = stated.shape[1]
    omega = np.linspace(5, 25, cells) if omega is None else omega
    found = with_stated(error([0, 0, 0, 0], cells), stated, np.ones(cells, bool), omega, USUAL)
    return found.covariance[:, Observable.speed, Observable.speed], found


def test_a_row_without_a_replicate_number_states_its_error_and_a_trial_does_not():
    variance, dof, behind, of_phi = bars(
        3.0, replicate=[NAN, 1.0, NAN, NAN], speed_sd_m_s=[0.01, 0.01, NAN, 0.02], phi_sd=[NAN, NAN, 0.001, 0.002]
    )
    np.testing.assert_allclose(variance, [0.01**2, NAN, NAN, 0.02**2])
    assert (dof == TRIALS_BEHIND - 1).all()
    assert (behind == 1).all()
    np.testing.assert_allclose(of_phi, [0, 0, 0.003**2, 0.006**2])


def test_a_standard_deviation_a_standard_error_and_the_number_of_trials_say_the_same():
    """The mean's variance is sd²/n; a standard error without n is that of the mean all the same."""
    sd, sem = [0.006] * 20, [0.003] * 20
    for how in ({"speed_sd_m_s": sd, "n_trials": [4] * 20}, {"speed_sem_m_s": sem, "n_trials": [4] * 20}):
        variance, found = pooled(bars(**how))
        np.testing.assert_allclose(variance, 0.003**2)
        assert found.dof[Observable.speed] == 20 * 3
    assert pooled(bars(speed_sem_m_s=sem))[0] == pytest.approx(0.003**2)
    # Without n, s.d. is taken for the error of the row as it stands.
    variance, found = pooled(bars(speed_sd_m_s=sd))
    np.testing.assert_allclose(variance, 0.006**2)
    assert found.dof[Observable.speed] == 20 * (TRIALS_BEHIND - 1)


def test_one_trial_has_no_error_bar_of_its_own_but_that_of_the_others():
    trials = np.where(np.arange(20) < 2, 1.0, 4.0)
    variance, found = pooled(bars(speed_sd_m_s=np.full(20, 0.006), n_trials=trials))
    np.testing.assert_allclose(variance, 0.006**2 / trials)
    assert found.dof[Observable.speed] == 18 * 3
    assert of_single_trials(np.array([[NAN], [0.006], [NAN], [NAN], [1.0]]))
    assert not of_single_trials(np.array([[NAN], [0.006], [NAN], [NAN], [2.0]]))


def test_error_bars_of_few_trials_are_pooled():
    """As if each were known, χ² of 24 means of three trials came to 48 or more: the true model was rejected."""
    p, rng = [], np.random.default_rng(1)
    for _ in range(200):
        values = rng.normal(0, 0.005, (24, 3))
        variance, found = pooled(bars(speed_sem_m_s=values.std(axis=1, ddof=1) / np.sqrt(3)))
        chi2 = float((values.mean(axis=1) ** 2 / variance).sum())
        p.append(float(f_sf(chi2 / 24, 24, found.dof[Observable.speed])))
    assert 0.01 < np.mean(np.array(p) < 0.05) < 0.12
    assert np.std(p) == pytest.approx(12**-0.5, abs=0.05)


@pytest.mark.parametrize(("trials", "ratio"), [(20, 2.0), (NAN, 4.0)])
def test_error_bars_that_truly_differ_are_obeyed(trials, ratio):
    wide = np.arange(24) % 8 == 0
    variance, found = pooled(bars(speed_sem_m_s=np.where(wide, ratio, 1.0) * 2e-3, n_trials=np.full(24, trials)))
    np.testing.assert_allclose(np.sqrt(variance), np.where(wide, ratio, 1.0) * 2e-3, rtol=1e-6)
    assert (found.own == wide).all()


def test_error_bars_that_grow_with_the_rate_of_the_legs_are_obeyed():
    omega = np.linspace(5, 25, 24)
    variance, _ = pooled(bars(speed_sem_m_s=1e-3 * (omega / 5)), omega)
    np.testing.assert_allclose(np.sqrt(variance), 1e-3 * (omega / 5), rtol=0.1)


def test_an_error_bar_of_phi_counts_where_it_is():
    variance, _ = pooled(bars(3.0, speed_sem_m_s=np.full(20, 2e-3), phi_sd=np.where(np.arange(20) < 5, 1e-3, 0.0)))
    np.testing.assert_allclose(variance, np.where(np.arange(20) < 5, 3e-3**2, 0.0) + 2e-3**2)


def test_error_bars_are_the_pure_error_where_nothing_was_repeated():
    """Few of them are shrunk towards the scatter of a usual lab, as replicates are; none is that of all."""
    variance, found = pooled(bars(speed_sd_m_s=[0.02, NAN]))
    assert variance == pytest.approx([(2 * 0.02**2 + 2 * USUAL[0] ** 2) / 4] * 2)
    assert found.sd[Observable.speed] == pytest.approx(np.sqrt(variance[0]))
    assert found.dof.tolist() == [TRIALS_BEHIND - 1, 0, 0, 0]
    assert found.covariance[:, Observable.lift, Observable.lift] == pytest.approx(1e-4)


def test_replicates_go_before_error_bars():
    replicated, nothing = error([6, 6, 6, 6]), error([0, 0, 0, 0])
    rest = (np.ones(2, bool), np.array([8.0, 9.0]), USUAL)
    assert with_stated(replicated, bars(speed_sd_m_s=[0.02, 0.02]), *rest) is replicated
    assert with_stated(nothing, bars(speed_sd_m_s=[NAN, NAN]), *rest) is nothing


def test_how_a_speed_with_an_error_bar_goes_with_what_was_repeated_is_taken_for_nothing():
    """A condition's mean, copied into the row of each of its trials: with it the whole fit came to NaN."""
    copied = error([0, 4, 4, 4], 20)
    copied.covariance[:, Observable.speed] = copied.covariance[..., Observable.speed] = NAN
    stated = bars(speed_sd_m_s=np.full(20, 0.02))
    found = with_stated(copied, stated, np.ones(20, bool), np.full(20, 8.0), USUAL).covariance
    np.testing.assert_allclose(found, np.tile(np.diag([0.02**2, 1e-4, 1e-4, 1e-4]), (20, 1, 1)))
