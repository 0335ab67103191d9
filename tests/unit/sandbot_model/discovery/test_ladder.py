"""The ladder as a table: what each step adds, its errors over the noise floor, and never wider than a line."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of, noise_floor
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.fitting.text import WIDTH, table
from sandbot_model.physics.catalogue import catalogue

LONGEST = ("exact_vertical_acceleration", "phi_dependent_response", "resistive_force_theory")


@pytest.fixture(scope="module")
def cells(drawn):
    return cells_of(drawn(levels=2, omega=(8, 14)))


@pytest.fixture(scope="module")
def steps(cells):
    return compare(cells, catalogue(), ["leg_slip", "stance_overlap"])


def test_each_step_names_what_it_adds_and_the_floor_is_last(steps, cells):
    head, *rows = ladder_rows(steps)
    assert [row[0] for row in rows] == ["simple", "+ leg_slip", "+ stance_overlap", "noise floor"]
    assert {len(row) for row in rows} == {len(head)}
    assert float(rows[0][1]) == pytest.approx(100 * steps[0].rmse_m_s, abs=0.005)
    assert float(rows[-1][1]) == pytest.approx(100 * noise_floor(cells)["speed"], abs=0.005)


def test_a_step_that_adds_nothing_is_held_by_hand(steps):
    assert [row[0] for row in ladder_rows([*steps, steps[-1]])][4] == "the same,\nheld by hand"


def test_without_replicates_there_is_no_floor(drawn):
    trials = drawn(levels=2, omega=(8, 14))
    once = trials.select(trials.replicate == trials.replicate.min())
    rows = ladder_rows(compare(cells_of(once), {}, []))
    assert [row[0] for row in rows] == ["model", "simple"]
    assert not any("nan" in cell for row in rows for cell in row)


def test_what_was_not_measured_has_no_column(drawn):
    trials = drawn(levels=2, omega=(8, 14))
    trials.peak_speed_m_s[:] = np.nan
    head = ladder_rows(compare(cells_of(trials), {}, []))[0]
    assert not any("peak" in title for title in head)
    assert any("lift" in title for title in head)


def test_with_the_longest_names_it_fits_a_line(steps):
    rows = [list(row) for row in ladder_rows(steps)]
    rows[1:1] = [[f"+ {name}", *("-12.345",) * (len(rows[0]) - 1)] for name in LONGEST]
    assert max(map(len, table(rows).splitlines())) <= WIDTH
