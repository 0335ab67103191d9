"""A number that nobody believes bars a claim only by an error that is known."""

from dataclasses import replace

import numpy as np

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.verdict import leaves_nothing, sound
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.physics.catalogue import catalogue


def searched(drawn, name: str, **values: float) -> EffectSearch:
    """Sets of one effect that acts so."""
    found = EffectSearch(
        cells_of(drawn((name,), seed=2, levels=7, values={name: values})), {name: catalogue()[name]}, "simple"
    )
    found.run(1)
    return found


def moved(fit: Fit, name: str, value: float) -> Fit:
    """The same with one parameter elsewhere."""
    theta = np.where(np.array(fit.model.names) == name, value, fit.point.theta)
    return fitted_at(fit.model, fit.cells, replace(fit.point, theta=theta))


def test_a_threshold_just_beyond_its_range_is_believed_where_it_is_known_no_better(drawn):
    """At the brink of a stair a derivative knows no error of it; 1.05 R is the most that is plausible."""
    search, names = searched(drawn, "disturbed_ground", s_c=1.045), ("disturbed_ground",)
    search.fits[names] = moved(search.fits[names], "disturbed_ground.s_c", 1.055)
    assert leaves_nothing(search.fits[names])
    assert not sound(search.fits[names])
    search.resolve_unknown_errors()
    assert sound(search.fits[names])
    assert search.fits[names].deviance > 150


def test_a_number_beyond_its_range_whose_error_is_known_is_not_believed(drawn):
    search, names = searched(drawn, "leg_slip", sigma=0.25), ("leg_slip",)
    before = search.fits[names]
    assert leaves_nothing(before)
    assert not sound(before)
    search.resolve_unknown_errors()
    assert not sound(search.fits[names])
