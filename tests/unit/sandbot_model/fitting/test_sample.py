"""A sample of what data do not exclude: a parabola's covariance, ends that are kept, members that find back."""

import numpy as np

from sandbot_model.fitting import sample
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import solve_near
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.sample import _Ensemble, _single_cell_offsets_marginalised, moments, posterior_points


def known(found: Fit) -> np.ndarray:
    return np.isfinite(found.stderr)


def test_of_a_parabola_a_sample_has_the_covariance(smooth, monkeypatch):
    monkeypatch.setattr(sample, "STEPS", 2000)
    free = known(smooth)
    found, linear = (
        moments(posterior_points(smooth.problem, smooth.state, free, [])),
        smooth.covariance[np.ix_(free, free)],
    )
    scale = np.sqrt(np.diag(linear))
    np.testing.assert_allclose(np.sqrt(np.diag(found)), scale, rtol=0.2)
    np.testing.assert_allclose(found / np.outer(scale, scale), linear / np.outer(scale, scale), atol=0.25)


def test_the_same_fit_has_the_same_sample(smooth):
    first, second = (moments(posterior_points(smooth.problem, smooth.state, known(smooth), [0])) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_beyond_its_ends_nothing_is_possible(smooth):
    ensemble = _Ensemble(smooth.problem, smooth.state, known(smooth))
    here, (low, _) = ensemble.here[None], ensemble.ends
    below = here.copy()
    below[0, 0] = low[0] - 1e-3
    assert np.isfinite(ensemble.ln_probability(here)).all()
    assert ensemble.ln_probability(below) == -np.inf


def test_what_is_not_free_stays_where_it_is(smooth, monkeypatch):
    monkeypatch.setattr(sample, "STEPS", 2000)
    free = known(smooth)
    free[0] = False
    own = smooth.covariance[np.ix_(free, free)]
    # With Δt held all else is known better, by what the covariance says.
    held = own - np.outer(smooth.covariance[free, 0], smooth.covariance[0, free]) / smooth.covariance[0, 0]
    found = np.sqrt(np.diag(moments(posterior_points(smooth.problem, smooth.state, free, []))))
    np.testing.assert_allclose(found, np.sqrt(np.diag(held)), rtol=0.2)


def beside(found: Fit, by_ln_k: np.ndarray, sd: float) -> Fit:
    """The same model beside offsets of the bed that move ln k of cells ``(cells, m)``."""
    count = by_ln_k.shape[1]
    shape = len(found.cells), 4, count
    own = Nuisances(
        ("ln_k",) * count, np.full(count, sd), np.zeros(shape), np.zeros(shape[0]), np.zeros(count), by_ln_k
    )
    point = solve_near((found.model, found.cells, (found.warm_start,), own))
    return fitted_at(found.model, found.cells, point, own)


def test_what_the_bed_is_off_by_under_single_conditions_need_not_be_sampled(smooth, monkeypatch):
    monkeypatch.setattr(sample, "STEPS", 2000)
    off, free = beside(smooth, np.eye(len(smooth.cells)), 0.004), known(smooth)
    slopes = full_jacobian(off.problem, off.state)[0][:, np.concatenate([free, np.ones(len(smooth.cells), dtype=bool)])]
    linear = np.linalg.inv(slopes.T @ slopes)[: free.sum(), : free.sum()]
    found = np.sqrt(np.diag(moments(posterior_points(off.problem, off.state, free, []))))
    np.testing.assert_allclose(found, np.sqrt(np.diag(linear)), rtol=0.2)
    # They do matter: on an even bed every k is known better.
    assert (found[2:] > 1.25 * smooth.stderr[free][2:]).all()


def test_what_it_is_off_by_on_a_day_is_sampled(smooth):
    cells = len(smooth.cells)
    days = np.repeat([[1.0, 0.0], [0.0, 1.0]], [4, cells - 4], axis=0)
    off = beside(smooth, np.column_stack([days, np.eye(cells)]), 0.004)
    problem, begin = _single_cell_offsets_marginalised(off.problem, off.state)
    assert problem.nuisances.by_ln_k.tolist() == days.tolist()
    assert _Ensemble(problem, begin, known(smooth)).bed.sum() == 2


def test_a_member_that_is_lost_is_put_where_others_are(smooth):
    # Here and not above: all workers collect this file, one runs it, and scipy.stats comes with it.
    import emcee

    ensemble = _Ensemble(smooth.problem, smooth.state, known(smooth))
    members = np.repeat(ensemble.here[None], 10, axis=0)
    members[3] += 0.5
    found = ensemble.strays_replaced(emcee.State(members, log_prob=ensemble.ln_probability(members)))
    np.testing.assert_array_equal(found, np.repeat(ensemble.here[None], 10, axis=0))
