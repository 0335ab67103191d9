"""Observables by name: one table of columns, units and noise that arrays, JSON and readers share."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

from sandbot_common.accuracy import USUAL
from sandbot_model.physics.observables import COLUMNS, NAMES, Observable, shared_variance, usual_noise
from sandbot_model.physics.walking import Inputs, Walker
from sandbot_record.trials.table import COLUMNS as TABLE


def test_names_are_those_of_the_json_and_columns_those_of_the_table():
    assert NAMES == ("speed", "lift", "peak_speed", "first_step")
    assert set(COLUMNS) <= set(TABLE)
    with pytest.raises(KeyError):
        Observable["height"]


def test_a_member_is_its_index_in_what_a_model_predicts():
    found = Walker().predict(Inputs([180.0, 200.0], 10.0, 0.4))
    for one in Observable:
        np.testing.assert_array_equal(found.observables[:, one], getattr(found, one.column))
    assert not np.array_equal(found.observables[:, Observable.speed], found.peak_speed_m_s)


@pytest.mark.parametrize("one", Observable)
def test_units_agree_with_the_column(one):
    assert one.column == f"{one.name}_{one.unit.replace('/', '_')}"
    assert one.heading.endswith(f"(c{one.unit})")


def test_every_number_of_an_accuracy_is_that_of_its_own_observable():
    """Errors of zero and scale, one for all trials, are no cell's: they are nuisances (`discovery.sharing`)."""
    values = np.array([0.2, 0.02, 0.3, 0.05])
    for name, value in vars(USUAL).items():
        other = replace(USUAL, **{name: value + 0.01})
        one = next(one for one in reversed(Observable) if name.startswith(one.name))
        noise = usual_noise(other) != usual_noise(USUAL)
        shared = shared_variance(other, values) != shared_variance(USUAL, values)
        own = name not in ("lift_zero_m", "speed_scale")
        assert noise.tolist() == [own and (one is here) and "_sd_" in name for here in Observable]
        assert shared.tolist() == [own and (one is here) and "_sd_" not in name for here in Observable]


def test_it_travels_to_workers_and_by_name_through_json():
    assert pickle.loads(pickle.dumps(Observable.lift)) is Observable.lift
    assert Observable[json.loads(json.dumps(Observable.lift.name))] is Observable.lift
