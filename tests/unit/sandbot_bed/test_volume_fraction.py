import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bed.volume_fraction import Measured, volume_fraction
from sandbot_common.errors import InputError

POSITIVE = st.floats(1e-3, 1e3)


def test_the_default_bed_is_0_580_when_loose():
    phi = volume_fraction(Measured(79.75), Measured(1100), Measured(1.25), Measured(0.1))
    assert phi.value == pytest.approx(0.580, rel=1e-12)
    assert phi.sd == 0


def test_uncertainties_add_in_quadrature():
    # 3 % and 4 % make 5 %.
    phi = volume_fraction(Measured(100, 3), Measured(1000), Measured(1.0), Measured(0.2, 0.008))
    assert phi.relative_sd == pytest.approx(0.05)


@given(POSITIVE, POSITIVE, POSITIVE, POSITIVE, st.integers(0, 3))
def test_each_quantity_contributes_its_relative_uncertainty(mass, density, area, height, which):
    parts = [
        Measured(value, 0.01 * value if i == which else 0) for i, value in enumerate((mass, density, area, height))
    ]
    assert volume_fraction(*parts).relative_sd == pytest.approx(0.01)


def test_uncertainty_agrees_with_random_draws():
    rng = np.random.default_rng(1)
    parts = [(79.75, 0.4), (1100, 5.0), (1.25, 0.005), (0.1, 0.0005)]
    mass, density, area, height = (rng.normal(mean, sd, 200_000) for mean, sd in parts)
    phi = volume_fraction(*(Measured(*part) for part in parts))
    assert np.std(mass / (density * area * height)) == pytest.approx(phi.sd, rel=0.02)


@pytest.mark.parametrize("values", [(0.0, 0.0), (math.nan, 0.0), (math.inf, 0.0), (1.0, -1.0), (1.0, math.nan)])
def test_refuses_what_is_no_measurement(values):
    with pytest.raises(InputError):
        Measured(*values)
