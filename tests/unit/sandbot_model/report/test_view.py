"""Which cells walk, of readings that scatter."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.report.view import walks
from sandbot_record.trials.table import Row, from_rows


def cells(speed_m_s, lift_m, lift_sd_m=3e-4):
    """One condition of three trials."""
    rows = [
        Row(
            phi=0.59, omega_rad_s=12.0, gait="UNIFORM", replicate=at, speed_m_s=speed_m_s + 0.003 * off,
            lift_m=lift_m + lift_sd_m * off,
        )
        for at, off in enumerate((-1.0, 0.0, 1.0))
    ]  # fmt: skip
    return cells_of(from_rows(rows))


@pytest.mark.parametrize(
    ("speed_m_s", "lift_m", "walking"),
    [
        (0.061, 4.2e-4, True),  # a lift that may be none, but three times as fast as a swimmer
        (0.061, 2e-3, True),
        (0.020, 4.2e-4, False),
        (0.037, 4.2e-4, False),  # as fast as walkers are, but not clearly
        (0.061, 0.0, False),  # a swimmer on other ground
    ],
)
def test_a_cell_walks_if_it_is_clearly_lifted_or_lifted_and_clearly_fast(speed_m_s, lift_m, walking):
    assert walks(cells(speed_m_s, lift_m)).tolist() == [walking]


def test_without_lifts_speed_decides():
    assert walks(cells(0.061, np.nan)).tolist() == [True]
    assert walks(cells(0.020, np.nan)).tolist() == [False]
