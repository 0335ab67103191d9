"""Curves of rivals: what a fit predicts, read as the cameras read it."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.design.curves import POINTS, curves
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}


@pytest.fixture(scope="module")
def base(drawn):
    return fit(model_of("simple", (), EFFECTS), cells_of(drawn(levels=2, omega=(6, 10, 14))))


def test_a_curve_is_what_the_fit_predicts(base):
    first, second = curves([base], {0.62, 0.6}, [14.0, 6.0])
    assert (first.phi, second.phi) == (0.6, 0.62)
    assert first.explanation == "the base model"
    assert (first.omega_rad_s[0], first.omega_rad_s[-1], len(first.omega_rad_s)) == (6.0, 14.0, POINTS)
    said = base.predict(np.full(POINTS, 0.6), np.array(first.omega_rad_s)).observables[:, Observable.speed]
    assert first.speed_m_s == pytest.approx(said, abs=1e-5)


def test_it_is_plain_data(base):
    (one,) = map(asdict, curves([base], {0.6}, [6.0, 14.0]))
    assert json.loads(json.dumps(one))["speed_m_s"] == list(one["speed_m_s"])
