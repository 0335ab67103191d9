"""Starts: an even sample, k profiled exactly, the best and distinct ones first."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.starts import MAX_STARTS, MIN_DISTANCE, profile, resample, search_box, starts
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of

EFFECTS = catalogue()


@pytest.fixture(scope="module")
def found(drawn):
    return fit(model_of("simple", ("leg_slip",), EFFECTS), cells_of(drawn(("leg_slip",), seed=1, levels=3)))


def _unit(model, theta):
    low, high = search_box(model)
    scaled = np.array(theta)
    scaled[model.names.index("delta_t_s")] = np.log(scaled[model.names.index("delta_t_s")])
    return (scaled - low) / (high - low)


def test_they_are_in_range_apart_and_best_first(found):
    tried = starts(found.problem, found.point.slope, found.k_n_per_m)
    assert 1 < len(tried) <= MAX_STARTS
    assert [start.deviance for start in tried] == sorted(start.deviance for start in tried)
    units = [_unit(found.model, start.theta) for start in tried]
    assert all(((unit > -1e-9) & (unit < 1 + 1e-9)).all() for unit in units)
    gaps = [np.abs(one - other).max() for i, one in enumerate(units) for other in units[:i]]
    assert min(gaps) > MIN_DISTANCE


def test_a_point_given_is_tried_too(found):
    """It is a start, unless a better one lies beside it."""
    point = found.point.theta * [1.0, 1.0, 0.5]
    without = starts(found.problem, found.point.slope, found.k_n_per_m)
    tried = starts(found.problem, found.point.slope, found.k_n_per_m, also=point[None])
    assert tried[0].deviance <= without[0].deviance
    gaps = [np.abs(_unit(found.model, start.theta) - _unit(found.model, point)).max() for start in tried]
    assert min(gaps) <= MIN_DISTANCE


def test_k_is_profiled_to_its_minimum(found):
    theta, grid = found.point.theta[None], np.geomspace(100.0, 500.0, 300)
    value, ln_k = profile(found.problem, theta, found.point.slope, found.k_n_per_m, grid)
    assert np.exp(ln_k[0]) == pytest.approx(found.k_n_per_m, rel=0.02)
    soft = profile(found.problem, theta, found.point.slope, found.k_n_per_m, grid[grid < 150])[0]
    assert soft[0] > 2 * value[0]


def test_without_an_effect_there_is_nothing_to_sample_once_more(found, drawn):
    more = resample(found.problem, found.point.theta, found.point.ln_k, found.point.slope)
    assert 0 < len(more) <= MAX_STARTS // 2
    assert all(abs(np.log(start.theta[0] / found.point.theta[0])) < 0.4 for start in more)
    base = fit(model_of("simple", (), EFFECTS), cells_of(drawn(levels=2)))
    assert resample(base.problem, base.point.theta, base.point.ln_k, base.point.slope) == []


@pytest.mark.filterwarnings("error")
def test_what_is_held_is_sampled_at_its_value_alone(found):
    model = model_of("simple", ("leg_slip",), EFFECTS, held={"delta_t_s": 1.2})
    problem = Problem(model, found.cells)
    tried = starts(problem, found.point.slope, found.k_n_per_m, also=found.point.theta[None])
    more = resample(problem, tried[0].theta, tried[0].ln_k, found.point.slope)
    assert more
    assert [start.theta[0] for start in (*tried, *more)] == pytest.approx([1.2] * len([*tried, *more]))
    assert len({float(start.theta[-1]) for start in more}) > 1
