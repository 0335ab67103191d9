"""What trials share: offsets adjusted with their priors, their derivatives, σ_b by REML, trends told from scatter."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.global_minimum import solve_near
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import (
    Nuisances,
    averaged_estimate,
    averaged_moments,
    effective,
    gains_for_errors,
    scatter_of_batches,
    trend_p,
)
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

MODEL = model_of("simple", (), catalogue())
POINT = np.array([[0.4, 0.02]]), np.log([[205.0, 215.0, 235.0]]), np.full((1, 3), 800.0)
TRIED = np.linspace(0.0, 0.02, 60)
PRIOR = 0.007


@pytest.fixture(scope="module")
def cells(drawn):
    return cells_of(drawn(levels=3, omega=(6, 12, 18)))


def lift_zero(cells, sd=1e-3, value=1.0, ln_k_sd=0.0):
    slope = np.zeros((len(cells), 4, 1))
    slope[:, Observable.lift] = value
    return nuisances_of(cells, ("lift_zero_m",), [sd], slope, ln_k_sd)


def nuisances_of(cells, names, sd, slope, ln_k_sd=0.0):
    """Nuisances that leave k as it is."""
    none = np.zeros((len(cells), len(names)))
    return Nuisances(names, np.array(sd), slope, np.full(len(cells), ln_k_sd), none[0], none)


def drawn_offsets(seed, sigma, batches=40, each=4, unknowns=6):
    """Whitened residuals of a linear fit whose batches are off by ``sigma``, its slopes, and those of the batches."""
    values, jacobian, slopes = drawn_values(seed, sigma, batches, each, unknowns)
    return values - jacobian @ np.linalg.lstsq(jacobian, values, rcond=None)[0], jacobian, slopes


def drawn_values(seed, sigma, batches, each, unknowns):
    """The same before it is fitted: the unknowns are 0."""
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(size=(batches * each, unknowns))
    slopes = np.zeros((batches * each, batches))
    slopes[np.arange(batches * each), np.repeat(np.arange(batches), each)] = 300.0 * rng.uniform(
        0.5, 1.5, batches * each
    )
    return rng.normal(size=batches * each) + slopes @ (sigma * rng.normal(size=batches)), jacobian, slopes


def lift_zero_anew_each_day(cells):
    """A zero for all, and one more for each of three days, of which cells of another day know nothing."""
    slope = np.zeros((len(cells), 4, 4))
    slope[:, Observable.lift, 0] = 1.0
    slope[np.arange(len(cells)), Observable.lift, 1 + np.arange(len(cells)) % 3] = 1.0
    return nuisances_of(cells, ("lift_zero_m", *3 * ("lift_zero_m of a day",)), [1e-3, 3e-4, 6e-4, 9e-4], slope)


@pytest.mark.parametrize("of", [lift_zero, lift_zero_anew_each_day])
def test_the_adjusted_deviance_is_that_of_the_wider_covariance(cells, of):
    plain = Problem(MODEL, cells).states(*POINT)
    problem = Problem(MODEL, cells, of(cells))
    state, sd = problem.states(*POINT), problem.nuisances.sd
    unit = problem.whitened(state.whiten, problem.nuisances.slope)[0].reshape(-1, len(sd)) * sd
    r = plain.all_residuals[0]
    assert state.deviance[0] == pytest.approx(r @ np.linalg.solve(np.eye(len(r)) + unit @ unit.T, r))
    assert state.deviance[0] < plain.deviance[0]


def test_a_nuisance_that_moves_nothing_changes_nothing(cells):
    plain = Problem(MODEL, cells).states(*POINT)
    state = Problem(MODEL, cells, lift_zero(cells, value=0.0)).states(*POINT)
    assert state.deviance == pytest.approx(plain.deviance)
    np.testing.assert_array_equal(state.predicted, plain.predicted)


def offset_of_k(cells, about):
    """One batch, which moves k of all cells, about a value; its slope is left out."""
    every = np.ones((len(cells), 1))
    return Nuisances(("ln_k",), np.array([0.01]), np.zeros((len(cells), 4, 1)), np.zeros(len(cells)), about, every)


def test_an_offset_moves_k_itself_not_what_is_predicted_along_a_slope(cells):
    theta, ln_k, slope = POINT
    about = np.array([0.03])
    moved = Problem(MODEL, cells, offset_of_k(cells, about)).states(*POINT, shared=about[None])
    same = Problem(MODEL, cells).states(theta, ln_k + 0.03, slope)
    np.testing.assert_allclose(moved.predicted, same.predicted, rtol=1e-12)
    assert moved.deviance == pytest.approx(same.deviance + 3.0**2)


def test_an_offset_that_a_wild_step_took_too_far_is_only_a_bad_one(cells):
    """And no overflow, which a user would be warned of."""
    problem = Problem(MODEL, cells, offset_of_k(cells, np.zeros(1)))
    there = problem.states(*POINT, shared=np.full((1, 1), 1e4))
    assert np.isfinite(there.predicted).all()
    assert there.deviance > 1e6


def test_a_fit_beside_offsets_is_where_its_own_likelihood_begins(cells):
    """Limits and profiles begin there: offsets as they were before they were fitted are another place."""
    apart = replace(cells, mean=Problem(MODEL, cells).states(POINT[0], POINT[1] + 0.03, POINT[2]).predicted[0])
    free = replace(offset_of_k(cells, np.zeros(1)), sd=np.array([1.0]))
    plain = fit(MODEL, apart)
    found = fitted_at(MODEL, apart, solve_near((MODEL, apart, (plain.warm_start,), free)), free)
    moved = fitted_at(MODEL, apart, replace(found.point, shared=np.array([0.02])), free)
    for one in (found, moved):
        np.testing.assert_array_equal(one.nuisances.initial, [value for value, _ in one.shared])
        again = one.problem.states(*(part[None] for part in (one.point.theta, one.point.ln_k, one.point.slope)))
        assert again.deviance[0] == pytest.approx(one.deviance)


def test_an_offset_of_nothing_moves_nothing(cells):
    state = Problem(MODEL, cells, offset_of_k(cells, np.zeros(1))).states(*POINT)
    np.testing.assert_array_equal(state.predicted, Problem(MODEL, cells).states(*POINT).predicted)


def expected(cells, mean=0.02):
    return replace(offset_of_k(cells, np.zeros(1)), mean=np.array([mean]))


@pytest.mark.parametrize("of", [lift_zero, lambda cells: offset_of_k(cells, np.array([0.004])), expected])
def test_its_column_of_the_jacobian_is_that_of_finite_differences(cells, of):
    problem = Problem(MODEL, cells, of(cells))
    state = problem.states(*POINT)
    here = problem.shared(state)
    sides = [problem.states(*POINT, here + step).all_residuals[0] for step in (1e-6, -1e-6)]
    jacobian = full_jacobian(problem, state)[0]
    assert jacobian.shape == (len(sides[0]), 2 + 3 + 1)
    np.testing.assert_allclose(jacobian[:, -1], (sides[1] - sides[0]) / 2e-6, rtol=1e-4, atol=1e-6)


def test_an_offset_of_every_cell_is_what_it_was_known_to_be(cells):
    """k takes up the rest: the data can tell no offset of all cells of a level."""
    plain = fit(MODEL, cells)
    for own in (expected(cells), offset_of_k(cells, np.zeros(1))):
        found = fitted_at(MODEL, cells, solve_near((MODEL, cells, (plain.warm_start,), own)), own)
        assert found.shared[0] == pytest.approx((own.mean[0], own.sd[0]), rel=0.01, abs=1e-4)
        assert found.deviance == pytest.approx(plain.deviance, abs=0.01)
        known = np.isfinite(plain.stderr[len(plain.point.theta) :])
        assert known.any()
        np.testing.assert_allclose((found.point.ln_k - plain.point.ln_k)[known], -own.mean[0], atol=1e-3)


def test_a_lift_read_too_high_is_found_and_a_right_one_is_not(drawn):
    trials = drawn(levels=3, omega=(6, 12, 18))
    for offset in (1e-3, 0.0):
        trials.lift_m[:] += offset
        cells = cells_of(trials)
        own = lift_zero(cells)
        point = solve_near((MODEL, cells, (fit(MODEL, cells).warm_start,), own))
        value, stderr = fitted_at(MODEL, cells, point, own).shared[0]
        assert abs(value - offset) < 3 * stderr < 6e-4
        trials.lift_m[:] -= offset


def test_a_shared_nuisance_widens_the_standard_errors(cells):
    plain = fit(MODEL, cells)
    beside = fitted_at(MODEL, cells, plain.point, lift_zero(cells))
    assert beside.stderr.shape == plain.stderr.shape
    wider = beside.stderr[np.isfinite(plain.stderr)] / plain.stderr[np.isfinite(plain.stderr)]
    assert wider.min() > 1 - 1e-9
    assert wider.max() > 1.01


def test_a_bed_that_scatters_widens_a_cell_beside_the_switch_whatever_its_replicates(cells):
    """There, and nowhere else, the offset decides whether all of them walk."""
    critical = np.log(np.linspace(160.0, 190.0, 61))[:, None] + np.zeros(3)
    at = np.repeat(POINT[0], 61, axis=0), critical, np.full((61, 3), 800.0)
    still, rough = (Problem(MODEL, cells, lift_zero(cells, 1e-9, 0.0, sd)).states(*at) for sd in (0.0, 0.01))
    speed = np.s_[..., Observable.speed, Observable.speed]
    assert rough.covariance[speed].max() > 1.5 * still.covariance[speed].max()
    clear = rough.footing.walking.all(axis=2)
    np.testing.assert_allclose(rough.covariance[speed][clear], still.covariance[speed][clear])


@pytest.mark.parametrize("sigma", [0.003, 0.01])
def test_reml_finds_the_scatter_of_batches(sigma):
    found = [scatter_of_batches(*drawn_offsets(seed, sigma), np.zeros((160, 0)), TRIED, 1.0) for seed in range(12)]
    assert np.mean([one for one, _ in found]) == pytest.approx(sigma, rel=0.15)
    assert min(gain for _, gain in found) > 6.0


def test_batches_that_do_not_differ_are_found_equal():
    found = [scatter_of_batches(*drawn_offsets(seed, 0.0), np.zeros((160, 0)), TRIED, PRIOR) for seed in range(20)]
    assert np.median([one for one, _ in found]) <= TRIED[2]
    assert max(gain for _, gain in found) < 6.0


def test_what_another_nuisance_explains_is_no_scatter_of_batches():
    residual, jacobian, slopes = drawn_offsets(3, 0.0)
    common = slopes.sum(axis=1)[:, None]
    off = residual + 0.01 * common[:, 0]
    assert scatter_of_batches(off, jacobian, slopes, np.zeros((160, 0)), TRIED, PRIOR)[0] > 0.005
    assert scatter_of_batches(off, jacobian, slopes, common * 0.02, TRIED, PRIOR)[0] < 0.002


def test_the_scatter_is_that_of_the_restricted_likelihood_however_the_unknowns_are_written():
    """-2 ln L = ln|K| + ln|JᵀK⁻¹J| + rᵀPr, worked out in full."""
    residual, jacobian, slopes = drawn_offsets(1, 0.005)

    def restricted(sigma):
        wide = np.eye(160) + sigma**2 * slopes @ slopes.T
        inner = jacobian.T @ np.linalg.solve(wide, jacobian)
        pull = jacobian.T @ np.linalg.solve(wide, residual)
        left = residual @ np.linalg.solve(wide, residual) - pull @ np.linalg.solve(inner, pull)
        return np.linalg.slogdet(wide)[1] + np.linalg.slogdet(inner)[1] + left

    turned = jacobian @ np.random.default_rng(5).normal(size=(6, 6))
    for slopes_of_unknowns in (jacobian, turned):
        sigma, gain = scatter_of_batches(residual, slopes_of_unknowns, slopes, np.zeros((160, 0)), TRIED, 1e3)
        assert gain == pytest.approx(restricted(0.0) - restricted(sigma), rel=1e-6)
        assert restricted(sigma) <= min(map(restricted, TRIED[10::10]))


def test_at_one_scatter_the_moments_are_those_of_generalised_least_squares():
    residual, jacobian, slopes = drawn_offsets(4, 0.005)
    others = 0.1 * np.random.default_rng(0).normal(size=(160, 2))
    wide = np.eye(160) + others @ others.T + 0.005**2 * slopes @ slopes.T
    covariance = np.linalg.inv(jacobian.T @ np.linalg.solve(wide, jacobian))
    away = covariance @ jacobian.T @ np.linalg.solve(wide, residual)
    moments = averaged_moments(residual, jacobian, slopes, others, np.array([0.005]), np.zeros(1))
    np.testing.assert_allclose(moments, covariance + np.outer(away, away), rtol=1e-9, atol=1e-12)


def test_an_estimate_averaged_over_the_scatter_is_that_of_its_posterior():
    contrasts, others, slopes = drawn_values(2, 0.005, 40, 4, 2)
    contrasts = contrasts + 1.5 * others[:, 0]
    wide = np.eye(160) + 0.005**2 * slopes @ slopes.T + others[:, 1:] @ others[:, 1:].T
    precision = 1.0 + others[:, 0] @ np.linalg.solve(wide, others[:, 0])
    mean = others[:, 0] @ np.linalg.solve(wide, contrasts) / precision
    found = averaged_estimate(contrasts, slopes, others, np.array([0.005]), np.zeros(1))
    assert found == pytest.approx((mean, precision**-0.5))
    # Of a scatter that is not known, the error is larger than with any one known.
    both = averaged_estimate(contrasts, slopes, others, np.array([0.0, 0.005]), np.zeros(2))
    assert both[1] > 0.7 * max(averaged_estimate(contrasts, slopes, others, np.array([0.005]), np.zeros(1))[1], 1e-9)
    # Control: contrasts that it does not move leave the prior.
    nothing = np.column_stack([np.zeros(160), others[:, 1]])
    assert averaged_estimate(contrasts, slopes, nothing, np.array([0.005]), np.zeros(1)) == pytest.approx((0.0, 1.0))


@pytest.mark.parametrize(("sigma", "days"), [(0.003, 5), (0.006, 7), (0.0, 20), (2 * PRIOR, 7)])
def test_errors_that_average_over_the_scatter_cover(sigma, days):
    """Few days tell little of how far days differ: errors of a bed taken for exact are too small."""
    z, exact = [], []
    for seed in range(120):
        values, _, slopes = drawn_values(seed, sigma, days, 12, 0)
        # A stiffness, and what follows the days; both are 0: what least squares finds is what it is off by.
        jacobian = slopes @ np.stack([np.ones(days), np.linspace(-1.0, 1.0, days)], axis=1)
        found = np.linalg.lstsq(jacobian, values, rcond=None)[0]
        residual, none = values - jacobian @ found, np.zeros((len(values), 0))
        given = residual, jacobian, slopes, none
        moments = averaged_moments(*given, *gains_for_errors(*given, PRIOR))
        z += (found / np.sqrt(np.diag(moments))).tolist()
        exact += (found / np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))).tolist()
    assert 0.6 <= np.mean(np.abs(z) < 1) <= 0.9
    assert np.mean(np.abs(z) < 2) >= 0.9
    if sigma:
        assert np.mean(np.abs(exact) < 1) < 0.5


def test_offsets_that_follow_something_are_told_from_scatter():
    where = np.linspace(-1.0, 1.0, 40)[:, None]
    told = []
    for seed in range(20):
        residual, jacobian, slopes = drawn_offsets(seed, 0.005)
        covariance = np.eye(160) + 0.005**2 * slopes @ slopes.T
        told.append(trend_p(residual, jacobian, covariance, slopes @ where))
        followed = residual + slopes @ (0.008 * where[:, 0])
        assert trend_p(followed, jacobian, covariance, slopes @ where) < 1e-4
    assert 0.25 < np.mean(told) < 0.75
    assert np.mean(np.array(told) < 0.01) < 0.1


def test_a_trend_that_the_fit_absorbs_tells_nothing():
    residual, jacobian, _ = drawn_offsets(0, 0.0)
    assert np.isnan(trend_p(residual, jacobian, np.eye(160), jacobian[:, :1]))


def test_nuisances_amount_to_as_many_unknowns_as_the_data_determine():
    assert effective(np.diag([1e3, 1e-3])) == pytest.approx(1.0, abs=1e-4)
