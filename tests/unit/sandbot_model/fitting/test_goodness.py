"""Errors and tests of a fit: against what they are by definition, and where there is nothing to test."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_lab.direct import direct_trials
from sandbot_lab.world import null_world
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.fitting import goodness
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.goodness import Estimate, Fail
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.trials.table import Row, from_rows

MODEL = model_of("simple", ("leg_slip",), catalogue())
PHI, OMEGA = np.linspace(0.58, 0.633, 7).tolist(), [4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0]


def test_the_rms_over_trials_is_that_of_the_trials_themselves(drawn):
    trials = drawn(levels=2, omega=(8, 12))
    cells = cells_of(trials)
    gap = np.full(cells.mean.shape, 0.003)
    within = np.sum((cells.n - 1) * cells.sd**2, axis=0)
    expected = np.sqrt((within + np.sum(cells.n, axis=0) * 0.003**2) / cells.n.sum(axis=0))
    assert list(goodness.rms(cells, gap).values()) == pytest.approx(expected)
    assert np.isnan(goodness.rms(cells, np.full(gap.shape, np.nan))["speed"])


def test_cell_means_missed_by_more_than_three_standard_errors_fail_the_worst_first(drawn):
    cells = cells_of(drawn(levels=2, omega=(8, 12)))
    z = np.zeros(cells.mean.shape)
    assert goodness.fails(cells, z, z) == ()
    z[1, 0], z[2, 3], z[3, 1] = 3.5, -9.0, 2.9
    assert [(fail.observable, fail.z) for fail in goodness.fails(cells, z, z)] == [("first_step", -9.0), ("speed", 3.5)]


def test_a_cell_that_fails_is_told_by_its_index_where_two_gaits_share_phi_and_omega(drawn):
    cells = cells_of(with_another_gait(drawn(levels=2, omega=(8, 12))))
    z = np.zeros(cells.mean.shape)
    one, other = np.flatnonzero((cells.phi == cells.phi[0]) & (cells.omega == cells.omega[0]))
    z[other, :2] = 5.0, -6.0
    found = goodness.fails(cells, z, z)
    assert [fail.cell for fail in found] == [other, other]
    assert goodness.cells_missed(found) == 1
    z[one, 0] = 4.0
    assert goodness.cells_missed(goodness.fails(cells, z, z)) == 2
    assert goodness.cells_missed(()) == 0


def test_in_the_json_a_cell_that_fails_is_told_by_phi_and_omega(drawn, monkeypatch):
    found = fit(model_of("simple", (), {}), cells_of(drawn(levels=2, omega=(8, 12))))
    monkeypatch.setattr(type(found), "fails", (Fail("speed", 0.6, 8.0, 0.1, 5.0, 3),))
    (told,) = found.to_dict()["fails"]
    assert list(told) == ["observable", "phi", "omega_rad_s", "residual", "z"]


def with_another_gait(trials):
    """The same trials once more, as those of another gait."""
    twice = trials.select(np.tile(np.arange(len(trials)), 2))
    return replace(twice, gait=np.repeat(["UNIFORM", "SGCS"], len(trials)))


def test_p_is_even_under_the_null_and_not_known_without_replicates():
    rng, dof, error_dof = np.random.default_rng(0), 20, 60
    cells = SimpleNamespace(pure_error_dof=np.array([error_dof]))
    scatter = rng.chisquare(error_dof, 2000) / error_dof
    p = [goodness.joint_p(c, dof, cells) for c in rng.chisquare(dof, 2000) / scatter]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.015)
    assert goodness.joint_p(200.0, dof, cells) < 1e-4
    assert np.isnan(goodness.joint_p(200.0, dof, SimpleNamespace(pure_error_dof=np.array([0]))))


@pytest.fixture
def lift_twice_in():
    """Lack of fit of the base model to worlds in which nothing is hidden, where lift is measured twice so often."""

    def p(cells, seed, off_m=0.0):
        rows = [Row(**row) for row in direct_trials(null_world(), PHI, OMEGA, seed=seed)]
        twice = set(np.random.default_rng(seed).choice(len(PHI) * len(OMEGA), cells, replace=False).tolist())
        kept = []
        for index, row in enumerate(sorted(rows, key=lambda row: row.trial_id)):
            measured = row.replicate == 0 or (row.replicate == 1 and index // 3 in twice)
            odd = off_m * (-1) ** (index // 3)
            kept.append(replace(row, lift_m=max(row.lift_m + odd, 0.0) if measured else np.nan))
        return fit(model_of("simple", (), {}), cells_of(from_rows(kept))).lack_of_fit_p

    return p


@pytest.mark.whole
@pytest.mark.parametrize("cells", [0, 1, 2, 4])
def test_a_scatter_known_from_few_replicates_refuses_no_true_model(lift_twice_in, cells):
    """Nine of fifteen were refused where one pair of lifts had agreed by chance."""
    assert sum(lift_twice_in(cells, seed) < DEFAULT.lack_of_fit for seed in range(12)) == 0


@pytest.mark.parametrize(("cells", "off_m"), [(4, 0.02), (40, 0.002)])
def test_and_still_refuses_what_is_far_off(lift_twice_in, cells, off_m):
    assert lift_twice_in(cells, 1, off_m) < DEFAULT.lack_of_fit


@pytest.mark.parametrize(
    ("value", "stderr", "out"),
    [
        (0.3, 0.02, True),
        (0.3, 0.2, True),
        (0.24, 0.02, False),
        (0.1, 0.001, False),
        # Known only together with others, and not at all: a staircase.
        (0.24, math.inf, False),
        (0.3, math.inf, True),
        (0.24, math.nan, True),
    ],
)
def test_a_parameter_is_implausible_three_standard_errors_or_a_quarter_of_its_range_outside(value, stderr, out):
    usual = {name: Estimate(one.start, 0.0) for name, one in zip(MODEL.names, MODEL.parameters, strict=True)}
    found = goodness.implausible(MODEL, usual | {"leg_slip.sigma": Estimate(value, stderr)})
    assert found == (("leg_slip.sigma",) if out else ())


def test_a_parameter_at_the_end_of_its_search_is_at_its_bound():
    problem = SimpleNamespace(model=MODEL)
    theta = np.array([one.start for one in MODEL.parameters])
    assert goodness.at_bounds(problem, theta) == ()
    theta[-1] = MODEL.parameters[-1].search[1]
    assert goodness.at_bounds(problem, theta) == (MODEL.names[-1],)


def test_what_is_held_by_hand_was_not_fitted():
    cells = cells_of(from_rows([Row(**row) for row in direct_trials(null_world(), PHI, OMEGA, replicates=2, seed=1)]))
    free = fit(MODEL, cells).goodness
    held = fit(replace(MODEL, held={"leg_slip.sigma": 0.0}), cells).goodness
    assert held.dof == free.dof + 1
