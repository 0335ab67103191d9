"""Walking or swimming, as measured."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.data.regime import WALKING_LIFT_M, WALKING_SPEED_M_S, starts_on_both_tripods, swam_from_start, walks
from sandbot_record.trials.table import Row, from_rows


@pytest.mark.parametrize(
    ("speed", "lift", "walked"),
    [
        (0.2, 0.005, True),
        (0.02, 0.005, True),
        (0.2, 0.0, False),
        (0.2, np.nan, True),
        (0.02, np.nan, False),
        (np.nan, 0.005, True),
        (np.nan, np.nan, False),
        (WALKING_SPEED_M_S, WALKING_LIFT_M, False),
    ],
)
def test_lift_says_it_and_speed_where_lift_is_missing(speed, lift, walked):
    assert walks(np.array([speed, lift, np.nan, np.nan])) == walked


@pytest.mark.parametrize(
    ("speed", "lift", "peak", "walked"),
    [
        (0.02, 8e-4, 0.02, False),
        (0.005, 8e-4, 0.14, True),
        (0.02, 8e-4, np.nan, False),
        (0.05, 8e-4, np.nan, True),
        (0.02, 2e-3, np.nan, True),
        (np.nan, 8e-4, np.nan, True),
        (0.005, 2e-3, 0.02, True),
    ],
)
def test_a_lift_zero_off_by_a_grain_makes_no_walkers(speed, lift, peak, walked):
    """Controls: a slow walker has the peak of its legs; without it, speed decides; and where it is lifted by more."""
    assert walks(np.array([speed, lift, peak, np.nan])) == walked


def test_a_surer_answer_asks_for_more_lift():
    values = np.array([[0.2, 1e-3, np.nan, np.nan], [0.2, 3e-3, np.nan, np.nan]])
    np.testing.assert_array_equal(walks(values), [True, True])
    np.testing.assert_array_equal(walks(values, 2e-3), [False, True])


WALKS, SWIMS = (0.2, 0.008, 0.4), (0.02, 0.0, np.nan)


@pytest.mark.parametrize(
    ("third", "peaks"),
    [
        (SWIMS, 0),
        # Controls: a marker was lost in a walk, or a swimmer's peak is given: the mean is that of all, or of any.
        ((0.2, 0.008, np.nan), 2),
        ((0.02, 0.0, 0.02), 3),
        (WALKS, 3),
    ],
)
def test_peaks_of_those_that_walked_are_not_the_mean_where_others_swam(third, peaks):
    """Measured only where the robot walked, it is missing where it would have been low."""
    rows = [
        Row(str(at), 0.6, np.nan, omega, "UNIFORM", 1.0, speed, np.nan, lift, peak, 0.03)
        for at, (omega, (speed, lift, peak)) in enumerate(
            [*((20.0, one) for one in (WALKS, WALKS, third)), (8.0, WALKS)]
        )
    ]
    cells = cells_of(from_rows(rows))
    assert cells.n[:, 2].tolist() == [1, peaks]
    assert np.isfinite(cells.mean[1, 2]) == bool(peaks)


@pytest.mark.parametrize(
    ("gait", "speed", "lift", "first", "left_out"),
    [
        ("SGCS", 0.02, 0.0, 0.002, True),
        ("SGCS", 0.02, np.nan, 0.002, True),
        ("UNIFORM", 0.02, 0.0, 0.002, False),
        ("SGCS", 0.02, 0.0, 0.035, False),
        ("SGCS", 0.2, 0.008, 0.03, False),
    ],
)
def test_the_first_step_of_a_swimmer_with_uneven_legs_says_nothing(gait, speed, lift, first, left_out):
    """Controls: even legs, a first step that held before the collapse, a walker."""
    omega, values = np.full(3, 12.0), np.tile([speed, lift, 0.1, first], (3, 1))
    assert swam_from_start([gait] * 3, omega, values).tolist() == [left_out] * 3
    trials = from_rows([Row("t", 0.6, 0.001, 12.0, gait, n, speed, np.nan, lift, 0.1, first, "ok") for n in range(3)])
    assert bool(np.isnan(cells_of(trials).mean[0, 3])) == left_out


def test_a_first_step_that_two_legs_take_says_nothing():
    gaits = ["SGCS", "UNIFORM", "HGCS", "CUSTOM(1.0 0.0 0.6)"]
    assert starts_on_both_tripods(gaits).tolist() == [False, False, True, True]
    row = Row("t", 0.6, 0.001, 12.0, "HGCS", 1, 0.1, np.nan, 0.004, 0.1, 0.03, "ok")
    assert np.isnan(cells_of(from_rows([row])).mean[0, 3])


def test_whether_a_condition_walks_does_not_depend_on_the_peaks_that_are_left_out(drawn):
    """Else what scatters there would count as a swimmer's scatter or a walker's by turns."""
    trials, cell = drawn(seed=4, levels=3), slice(0, 3)
    barely = {"speed_m_s": [0.02, 0.03, 0.025], "lift_m": [4e-4, 5e-4, 6e-4], "peak_speed_m_s": [0.4, 0.41, 0.4]}
    columns = {name: getattr(trials, name).copy() for name in barely}
    for name, values in barely.items():
        columns[name][cell] = values
    whole = cells_of(replace(trials, **columns))
    columns["peak_speed_m_s"][1:3] = np.nan
    part = cells_of(replace(trials, **columns))
    assert (whole.n[0, 2], part.n[0, 2]) == (3, 0)
    np.testing.assert_allclose(part.sem[0, [0, 1, 3]], whole.sem[0, [0, 1, 3]], rtol=0.1)
