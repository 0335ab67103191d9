"""A DataFrame is read as the CSV of the same table would be, whatever says in it that nothing was measured."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_record.trials.frame import from_frame


class NAType:
    """As pandas.NA: no comparison with it is true or false."""

    def __eq__(self, other):
        return self

    __ne__ = __eq__
    __hash__ = None

    def __bool__(self):
        raise TypeError("boolean value of NA is ambiguous")


@pytest.mark.parametrize("nothing", [None, math.nan, np.datetime64("NaT"), NAType()])
def test_what_was_not_measured_is_not_measured(nothing):
    rows = [(0.6, 8, 0.2, 1, 0.004), (0.62, 8, 0.25, nothing, nothing)]
    frame = SimpleNamespace(
        columns=["phi", "omega_rad_s", "speed_m_s", "replicate", "lift_m"], itertuples=lambda **_: iter(rows)
    )
    table = from_frame(frame)
    assert table.replicate[0] == 1
    assert np.isnan([table.replicate[1], table.lift_m[1]]).all()
