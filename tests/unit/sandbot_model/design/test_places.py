"""Where trials can be run: what is said of a place is said of the gait that it is run in."""

import numpy as np
import pytest

from sandbot_model.design.explanations import explained_by, readings
from sandbot_model.design.places import Places
from sandbot_model.physics.gait import clock

CONDITIONS = [(0.633, 10.0), (0.633, 14.0)]


@pytest.mark.parametrize(
    ("gait", "of", "other"), [("", "SGCS", "HGCS"), ("SGCS", "SGCS", "HGCS"), ("HGCS", "HGCS", "SGCS")]
)
def test_an_explanation_is_of_the_gait_that_is_run(two_gaits, gait, of, other):
    places = Places.of(CONDITIONS, two_gaits, gait)
    said, differs = (readings(two_gaits, places.phi, places.omega, clock([one])[0]) for one in (of, other))
    np.testing.assert_allclose(explained_by(two_gaits, places).mean, said * places.precision)
    assert np.abs(said - differs).max() > 5e-3


def test_trials_of_another_gait_are_none_at_a_place(two_gaits):
    level = [(float(phi), 6.0) for phi in two_gaits.level_phi]
    assert np.isfinite(Places.of(level, two_gaits, "HGCS").known[:, 0]).all()
    assert np.isinf(Places.of(level, two_gaits, "SGCS").known).all()
