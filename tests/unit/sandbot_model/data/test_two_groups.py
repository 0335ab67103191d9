"""The split of trials is the best of all, found in the table's order or in that of the runs."""

import numpy as np

from sandbot_model.data.two_groups import LEAST_DOF, two_groups

CELL = np.repeat(np.arange(8), 5)
NAMES = np.array([f"t{at}" for at in range(len(CELL))])
NOT_RUN = np.full(len(CELL), np.nan)


def about_means(values):
    means = np.array([np.nanmean(values[cell == CELL], axis=0) for cell in range(8)])
    return values - means[CELL]


def noise(seed, scale=1.0):
    return scale * np.random.default_rng(seed).normal(size=(len(CELL), 4))


def test_two_groups_that_differ_in_each_condition_are_found_in_the_order_of_their_runs():
    order = np.random.default_rng(1).permutation(len(CELL)).astype(float)
    apart = np.random.default_rng(2).normal(size=(8, 4))
    residual = about_means(noise(3, 0.01) + np.where(order[:, None] < 17, apart[CELL], 0.0))
    found = two_groups(residual, CELL, NAMES, order)
    assert (found.last, found.first) == (NAMES[order == 16][0], NAMES[order == 17][0])
    assert (np.abs(found.sd / 0.01 - 1) < 0.4).all()
    by_row = two_groups(residual, CELL, NAMES, NOT_RUN)
    assert by_row is None or (by_row.sd > 0.1).any()


def test_the_scatter_left_is_that_within_conditions_and_groups():
    values, order = noise(5), np.random.default_rng(4).permutation(len(CELL))
    values[3, 1] = np.nan
    residual, cell = about_means(values)[order], CELL[order]
    found = two_groups(residual, cell, NAMES, NOT_RUN)
    later = np.arange(len(CELL)) > np.flatnonzero(found.last == NAMES)[0]
    for column, sd in zip(residual.T, found.sd, strict=True):
        groups = [column[(cell == one) & (later == side) & np.isfinite(column)] for one in range(8) for side in (0, 1)]
        groups = [group for group in groups if len(group)]
        dof = sum(len(group) - 1 for group in groups)
        assert np.isclose(sd**2, sum(np.sum((group - group.mean()) ** 2) for group in groups) / dof)


def test_of_a_steady_drift_a_quarter_is_left_and_few_replicates_tell_nothing():
    order = np.random.default_rng(6).permutation(len(CELL)).astype(float)
    drift = about_means(np.repeat(order[:, None], 4, axis=1) + noise(7, 0.01))
    found = two_groups(drift, CELL, NAMES, order)
    dof = len(CELL) - 8
    assert (found.sd**2 / (np.sum(drift**2, axis=0) / dof) > 0.15).all()
    few = CELL < LEAST_DOF // 4
    assert two_groups(drift[few], CELL[few], NAMES[few], order[few]) is None
