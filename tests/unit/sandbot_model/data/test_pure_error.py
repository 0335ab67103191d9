"""Pure error: the replicates' own scatter comes out, whatever the model would say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbot_model.data.pure_error import (
    FLOOR,
    PRIOR_DOF,
    consistent_cells,
    pure_error,
    within_batches,
    without_batch_effects,
)

SCALE = np.array([5e-3, 5e-4, 1e-2, 1.5e-3])


def about_means(values, cell, replicates):
    """Values ``(trials, 4)`` about the mean of their cell."""
    return values - np.stack([np.bincount(cell, column) / replicates for column in values.T], axis=-1)[cell]


def scattered(cells=40, replicates=4, seed=0, correlation=0.0, omega=None):
    """Arguments of ``pure_error`` for replicates that scatter by ``SCALE`` in every cell."""
    rng = np.random.default_rng(seed)
    cell = np.repeat(np.arange(cells), replicates)
    common = rng.normal(size=(len(cell), 1))
    values = (np.sqrt(correlation) * common + np.sqrt(1 - correlation) * rng.normal(size=(len(cell), 4))) * SCALE
    omega = np.full(cells, 8.0) if omega is None else omega
    return (
        about_means(values, cell, replicates),
        cell,
        np.full((cells, 4), replicates),
        np.ones(cells, dtype=bool),
        omega,
        SCALE,
    )


@settings(max_examples=30)
@given(st.integers(0, 2**16))
def test_the_scatter_drawn_is_the_scatter_found(seed):
    error = pure_error(*scattered(seed=seed))
    np.testing.assert_allclose(error.sd, SCALE, rtol=0.3)
    np.testing.assert_array_equal(error.dof + 3 * error.own.sum(), 120)
    assert error.own.mean() <= 0.1


def test_observables_that_move_together_are_seen_to():
    def correlation(of):
        covariance = pure_error(*scattered(correlation=of)).covariance[0]
        return covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])

    assert correlation(0.9) > 0.6
    assert abs(correlation(0.0)) < 0.25


@given(st.floats(1e-3, 1e3))
def test_the_unit_does_not_matter(unit):
    residual, *rest, usual = scattered()
    here, there = pure_error(residual, *rest, usual), pure_error(residual * unit, *rest, usual * unit)
    if (SCALE * unit > 100 * FLOOR).all():
        np.testing.assert_allclose(there.sd, here.sd * unit, rtol=1e-6)
        np.testing.assert_array_equal(there.own, here.own)


@given(st.permutations(range(40)))
def test_the_order_of_cells_does_not_matter(order):
    residual, cell, count, walking, omega, _ = scattered()
    place = np.argsort(order)
    moved = pure_error(residual, place[cell], count, walking, omega, SCALE)
    here = pure_error(residual, cell, count, walking, omega, SCALE)
    np.testing.assert_allclose(moved.covariance[place], here.covariance, rtol=1e-9)


def test_no_replicates_no_error():
    error = pure_error(
        np.zeros((5, 4)), np.arange(5), np.ones((5, 4), dtype=int), np.ones(5, dtype=bool), np.arange(1.0, 6), SCALE
    )
    assert np.isnan(error.sd).all()
    assert (error.dof == 0).all()


def test_replicates_that_agree_to_the_last_bit_prove_nothing():
    residual, *rest = scattered()
    for factor in (0.0, 1e-3 * FLOOR):
        error = pure_error(factor * residual, *rest)
        assert np.isnan(error.sd).all()
        assert (error.dof == 0).all()
    one = pure_error(residual * [0.0, 1.0, 1.0, 1.0], *rest)
    np.testing.assert_array_equal(one.dof, [0, 120, 120, 120])
    assert np.isfinite(one.covariance[:, 1:, 1:]).all()
    np.testing.assert_allclose(one.covariance[:, 1:, 1:], pure_error(residual, *rest).covariance[:, 1:, 1:])


@pytest.mark.parametrize("pairs", [1, 2, 6])
def test_a_usual_lab_counts_beside_few_replicates_and_not_beside_many(pairs):
    """One pair that agrees by chance is no precise instrument."""
    cell = np.concatenate([np.repeat(np.arange(pairs), 2), np.arange(pairs, 40)])
    count = np.where(np.arange(40) < pairs, 2, 1)[:, None] * np.ones((1, 4), dtype=int)
    residual = np.zeros((len(cell), 4))
    residual[: 2 * pairs : 2], residual[1 : 2 * pairs : 2] = 1e-3 * SCALE, -1e-3 * SCALE
    error = pure_error(residual, cell, count, np.ones(40, dtype=bool), np.full(40, 8.0), SCALE)
    least = np.sqrt(PRIOR_DOF / (pairs + PRIOR_DOF)) * SCALE
    assert (np.sqrt(np.diagonal(error.covariance[0])) >= 0.99 * least).all()
    assert (error.sd < 0.01 * SCALE).all()  # what is told of the replicates is their own

    many, *rest, _ = scattered()
    here, there = (pure_error(many, *rest, usual * SCALE).covariance for usual in (1.0, 100.0))
    np.testing.assert_array_equal(here, there)


def test_walking_and_swimming_are_pooled_apart():
    residual, cell, count, walking, omega, _ = scattered()
    walking[20:] = False
    residual[cell >= 20] *= 0.1
    error = pure_error(residual, cell, count, walking, omega, SCALE)
    assert np.sqrt(error.covariance[:20, 0, 0].mean()) == pytest.approx(5e-3, rel=0.3)
    # A little of the common scatter counts in each regime.
    assert 4e-4 < np.sqrt(error.covariance[20:, 0, 0].mean()) < 1e-3


def test_a_cell_that_flips_stands_on_its_own_scatter():
    rng = np.random.default_rng(0)
    cells, replicates = 20, 3
    cell = np.repeat(np.arange(cells), replicates)
    residual = rng.normal(0, 0.005, (cells * replicates, 4))
    residual[:3] = [[0.08] * 4, [-0.04] * 4, [-0.04] * 4]
    count = np.full((cells, 4), replicates)
    error = pure_error(residual, cell, count, np.ones(cells, dtype=bool), np.full(cells, 8.0), SCALE)
    assert error.own[0]
    assert error.own.sum() <= 2
    assert error.sd[0] == pytest.approx(0.005 * np.sqrt(2 / 3), rel=0.5)
    assert np.sqrt(error.covariance[0, 0, 0]) > 0.05
    assert np.sqrt(error.covariance[5, 0, 0]) < 0.01


@pytest.mark.parametrize(("cells", "replicates", "flips", "power"), [(7, 2, 1, 0.0), (14, 2, 2, 0.5), (35, 3, 8, 1.0)])
def test_few_cells_that_flip_are_no_scatter_of_all(cells, replicates, flips, power):
    """By the mean they hide themselves: in so few cells it is theirs."""
    found, apart = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        omega, cell = rng.choice([4.0, 8.0, 12.0, 16.0, 24.0], cells), np.repeat(np.arange(cells), replicates)
        values = rng.normal(size=(len(cell), 4)) * (omega[cell] ** power)[:, None]
        values[np.arange(flips) * replicates] += 40 * omega[:flips, None] ** power
        count, walking = np.full((cells, 4), replicates), np.ones(cells, dtype=bool)
        error = pure_error(about_means(values, cell, replicates), cell, count, walking, omega, np.ones(4))
        apart.append(error.own[:flips].all() and error.own[flips:].mean() < 0.2)
        found.append(np.median(np.sqrt(error.covariance[flips:, 0, 0]) / omega[flips:] ** power))
    assert np.mean(apart) > 0.95
    assert np.median(found) == pytest.approx(1.0, abs=0.15)


def test_scatter_that_follows_frequency_is_followed():
    rng = np.random.default_rng(2)
    omega = np.repeat([4.0, 8.0, 16.0, 30.0], 10)
    cell = np.repeat(np.arange(40), 3)
    residual = about_means(rng.normal(size=(120, 4)) * (1e-3 * omega[cell])[:, None], cell, 3)
    error = pure_error(residual, cell, np.full((40, 4), 3), np.ones(40, dtype=bool), omega, SCALE)
    found = np.sqrt(error.covariance[:, 0, 0])
    np.testing.assert_allclose(found / (1e-3 * omega), 1.0, atol=0.45)


def test_scatter_that_does_not_follow_frequency_is_not_made_to():
    error = pure_error(*scattered(omega=np.repeat([4.0, 8.0, 16.0, 30.0], 10)))
    slow, fast = np.sqrt(error.covariance[[0, -1], 0, 0])
    assert fast == pytest.approx(slow, rel=0.4)


def slowest_and_fastest(swimming_power, seed):
    """Standard deviation taken over the one drawn, of the slowest and fastest of seven swimming cells beside 42."""
    rng = np.random.default_rng(seed)
    omega, walking = np.tile([4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0], 7), np.arange(49) >= 7
    sd = 4e-3 * np.where(walking, 1.0, (omega / 14) ** swimming_power)
    cell = np.repeat(np.arange(49), 3)
    residual = about_means(rng.normal(size=(147, 4)) * sd[cell, None], cell, 3)
    error = pure_error(residual, cell, np.full((49, 4), 3), walking, omega, np.full(4, 4e-3))
    return np.sqrt(error.covariance[[0, 6], 0, 0]) / sd[[0, 6]]


def test_few_swimmers_do_not_make_a_trend_of_their_luck():
    found = np.array([slowest_and_fastest(0.0, seed) for seed in range(100)])
    np.testing.assert_allclose(np.median(found, axis=0), 1.0, atol=0.15)
    assert np.quantile(found, 0.025, axis=0).min() > 0.4


def test_swimmers_that_do_follow_frequency_are_followed():
    found = np.array([slowest_and_fastest(1.0, seed) for seed in range(100)])
    slow, fast = np.median(found, axis=0)
    assert slow < 2.0
    assert fast > 0.6


@pytest.mark.parametrize("seed", range(5))
def test_what_a_batch_adds_to_all_its_trials_is_no_scatter_of_replicates(seed):
    """A lift zero of each day; controls: equal days, and days that share no cell, change nothing."""
    residual, cell, *_ = scattered(seed=seed)
    shape, day, every = np.ones((40, 4)), np.tile(np.array(["mon", "tue", "wed", "wed"]), 40), np.ones(40, dtype=bool)
    zero = np.array([0.0, 1e-3, 2e-3, 2e-3])
    off = residual + about_means(np.tile(zero, 40)[:, None] * np.array([0, 1, 0, 0]), cell, 4)
    found = without_batch_effects(off, cell, shape, day, every)
    np.testing.assert_allclose(np.sqrt((found[:, 1] ** 2).sum() / 120), SCALE[1], rtol=0.2)
    assert np.sqrt((off[:, 1] ** 2).sum() / 120) > 1.5 * SCALE[1]
    np.testing.assert_array_equal(found[:, [0, 2, 3]], residual[:, [0, 2, 3]])
    np.testing.assert_array_equal(without_batch_effects(residual, cell, shape, day, every), residual)
    np.testing.assert_array_equal(without_batch_effects(off, cell, shape, cell.astype(str), every), off)


@pytest.mark.parametrize("seed", range(5))
def test_conditions_that_stop_walking_on_a_soft_day_are_no_scale_of_the_readings(seed):
    """On the last day every fifth condition swims, all others are as ever; control: with these among the conditions
    that tell the days' scales, all of them seem to scatter more."""
    residual, cell, count, walking, omega, usual = scattered(seed=seed)
    shape, day = np.full((40, 4), 0.15), np.tile(np.array(["mon", "tue", "wed", "thu"]), 40)
    swims = np.zeros((160, 4))
    swims[(day == "thu") & (cell % 5 == 0), 0] = -0.12
    off = residual + about_means(swims, cell, 4)
    consistent = consistent_cells(off, cell, count, walking, omega)

    def scatter(consistent):
        found = without_batch_effects(off, cell, shape, day, consistent)
        return pure_error(found, cell, count, walking, omega, usual)

    assert not consistent[::5].any()
    error = scatter(consistent)
    np.testing.assert_allclose(error.sd, SCALE, rtol=0.3)
    assert error.own[::5].all()
    assert scatter(np.ones(40, dtype=bool)).sd[0] > 2 * SCALE[0]


def test_batches_that_differ_otherwise_in_each_cell_leave_the_scatter_within_them():
    """Another k changes each cell differently; controls: batches alike, one trial a cell of each, and nested ones."""
    residual, cell, count, walking, omega, usual = scattered()
    every, table = np.ones(40, dtype=bool), np.tile(np.array(["one", "one", "two", "two"]), 40)
    response = np.repeat(np.linspace(-3.0, 6.0, 40), 4) * SCALE[0] * (table == "two")
    off = residual + about_means(response[:, None] * [1, 0, 0, 0], cell, 4)
    found, independent = within_batches(off, cell, count, table, every)
    np.testing.assert_array_equal(independent[:, 0], 3)
    error = pure_error(found, cell, independent, walking, omega, usual)
    np.testing.assert_allclose(error.sd, SCALE, rtol=0.3)
    assert error.dof[0] >= 60
    assert pure_error(off, cell, count, walking, omega, usual).sd[0] > 1.5 * SCALE[0]
    np.testing.assert_array_equal(found[:, 1:], residual[:, 1:])
    np.testing.assert_array_equal(independent[:, 1:], count[:, 1:])
    for values, batch in ((residual, table), (off, np.tile(np.array(list("abcd")), 40)), (off, cell.astype(str))):
        same, all_of_them = within_batches(values, cell, count, batch, every)
        np.testing.assert_array_equal(same, values)
        np.testing.assert_array_equal(all_of_them, count)


def test_where_one_batch_walks_and_another_swims_their_difference_is_scatter():
    residual, cell, count, *_ = scattered()
    table = np.tile(np.array(["one", "one", "two", "two"]), 40)
    off = residual + about_means(np.where(table == "two", 0.1, 0.0)[:, None] * np.ones(4), cell, 4)
    some = np.arange(40) > 0
    found, independent = within_batches(off, cell, count, table, some)
    np.testing.assert_array_equal(found[:4], off[:4])
    np.testing.assert_array_equal(independent[:2], [[4] * 4, [3] * 4])


def test_too_few_trials_within_batches_tell_no_scatter():
    """Eleven pairs within batches; control: twelve."""
    rng = np.random.default_rng(0)
    for cells, told in ((11, False), (12, True)):
        cell, count = np.repeat(np.arange(cells), 3), np.full((cells, 1), 3)
        table = np.tile(np.array(["one", "one", "two"]), cells)
        values = rng.normal(0, 1, (3 * cells, 1)) + 20.0 * (table == "two")[:, None]
        residual = about_means(values, cell, 3)
        _, independent = within_batches(residual, cell, count, table, np.ones(cells, dtype=bool))
        assert (independent < count).all() == told
