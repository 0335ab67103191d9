"""Levels of a measured value, and values that are the same within a tolerance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.data.clustering import WIDEST_SCATTER, phi_levels, same_within


def drawn(count, replicates, scatter, seed):
    """Volume fractions about targets 0.0075 apart, as seven between 0.580 and 0.633 are, and their targets."""
    rng = np.random.default_rng(seed)
    targets = np.repeat(np.arange(count), replicates)
    phi = 0.57 + 0.0075 * targets + np.clip(rng.normal(0, 1, len(targets)), -2.5, 2.5) * scatter
    order = rng.permutation(len(phi))
    return phi[order], targets[order]


@given(st.integers(1, 8), st.integers(9, 24), st.floats(0.0, 4e-4), st.integers(0, 2**16))
def test_levels_are_the_targets(count, replicates, scatter, seed):
    phi, targets = drawn(count, replicates, scatter, seed)
    np.testing.assert_array_equal(phi_levels(phi), targets)


@pytest.mark.parametrize(("count", "replicates"), [(1, 9), (2, 9), (7, 9), (1, 24), (7, 21)])
def test_levels_that_scatter_more_are_hardly_ever_split(count, replicates):
    """At 0.0007, 0.5 % of single levels of nine were split in 600 draws, none of those of 24."""
    wrong = sum(
        not np.array_equal(phi_levels(phi), targets)
        for phi, targets in (drawn(count, replicates, 7e-4, seed) for seed in range(100))
    )
    assert wrong <= 2


def test_close_targets_are_told_apart_and_one_level_is_not_split():
    rng = np.random.default_rng(3)
    two = np.concatenate([rng.normal(0.6, 4e-4, 21), rng.normal(0.604, 4e-4, 21)])
    assert phi_levels(two).max() == 1
    for seed in range(20):
        assert phi_levels(np.random.default_rng(seed).normal(0.6, 7e-4, 21)).max() == 0


@given(st.lists(st.floats(0.55, 0.65), min_size=1, max_size=40))
def test_levels_are_counted_from_the_loosest_without_a_gap(phi):
    phi = np.array(phi)
    level = phi_levels(phi)
    assert sorted(set(level.tolist())) == list(range(level.max() + 1))
    assert (np.diff(level[np.argsort(phi, kind="stable")]) >= 0).all()


def test_two_values_that_never_scatter_are_two_levels():
    np.testing.assert_array_equal(phi_levels(np.array([0.6, 0.62] * 6)), [0, 1] * 6)
    assert phi_levels(np.full(12, 0.6)).max() == 0


def test_frequencies_within_tolerance_are_one():
    np.testing.assert_array_equal(same_within(np.array([8.0, 4.0, 8.01, 4.001, 12.0]), 5e-3), [1, 0, 1, 0, 2])


@given(st.lists(st.floats(1.0, 40.0), min_size=1, max_size=30), st.floats(1e-4, 0.1))
def test_what_is_far_apart_is_not_the_same_and_neighbours_are(values, tolerance):
    values = np.array(values)
    group = same_within(values, tolerance)
    order = np.argsort(values)
    step, joined = np.diff(values[order]), np.diff(group[order]) == 0
    np.testing.assert_array_equal(joined, step <= tolerance * values[order][1:])


@pytest.mark.parametrize("scatter", [3e-3, 6e-3])
def test_levels_that_run_into_one_another_are_classes_no_wider_than_replicates_may_be(scatter):
    """Seven targets met badly were one level of a scatter of 0.016, in which any model passes."""
    phi, _ = drawn(7, 21, scatter, 0)
    level = phi_levels(phi)
    assert max(np.std(phi[level == one]) for one in range(level.max() + 1)) <= WIDEST_SCATTER
    assert 7 < level.max() + 1 < 20
