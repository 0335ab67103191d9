"""Batches whose beds differ by more than beds do are told with the difference of k; others are not."""

from dataclasses import replace

import pytest

from sandbot_lab.direct import direct_trials
from sandbot_lab.world import World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import batches_apart
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.trials.table import Row, from_rows

PHI, OMEGA = (0.59, 0.611, 0.633), (6.0, 10.0, 14.0, 18.0)


def table(batch, softer, seed):
    """Trials of one table, on a bed whose k is less by ``softer``."""
    world = World()
    world = replace(world, week=replace(world.week, k_jump=-softer, k_jumps_at=(0.0,)))
    rows = direct_trials(world, PHI, OMEGA, "UNIFORM", 2, seed, None, "randomised", "replicate")
    return [replace(Row(**row), trial_id=f"{batch}{at}", batch=batch) for at, row in enumerate(rows)]


def said(*tables):
    cells = cells_of(from_rows([row for rows in tables for row in rows]))
    return batches_apart.in_words(fit(model_of("simple", (), catalogue()), cells), DEFAULT)


@pytest.mark.parametrize("softer", [0.06, 0.0])
def test_two_tables_whose_beds_differ(softer):
    text = said(table("one", 0.0, 1), table("two", softer, 2))
    if not softer:
        assert text == ""
        return
    percent, error = (float(text.split()[at]) for at in (5, 7))
    assert text.startswith("the two batches differ by ")
    assert abs(percent - 100 * softer) < 3 * error + 0.3


def test_one_table_says_nothing():
    assert said(table("one", 0.06, 1)) == ""


def test_tables_that_share_no_condition_say_nothing():
    one, two = table("one", 0.0, 1), table("two", 0.06, 2)
    apart = [row for row in one if row.omega_rad_s < 12] + [row for row in two if row.omega_rad_s > 12]
    assert said(apart) == ""
