"""Rows without video: the table's columns, the world's noise, and readings that know what is not measured."""

import numpy as np
import pytest
from rig import QUIET, expected, setpoints, with_noise

from sandbot_common.errors import InputError
from sandbot_lab.direct import COLUMNS, ReadingErrors, direct_trials, readings
from sandbot_lab.robot import simulate
from sandbot_lab.world import draw_world, null_world

EXACT = ReadingErrors(phi=0.0, speed_m_s=0.0, lift_m=0.0, peak=0.0, peak_m_s=0.0, first_step_m=0.0)


def test_rows_follow_the_simple_model_without_noise():
    rows = direct_trials(QUIET, [0.6, 0.62], [8.0, 16.0], replicates=1, errors=EXACT)
    assert len(rows) == 4
    for row in rows:
        assert tuple(row) == COLUMNS
        speed, lift, peak, step = expected(QUIET.stiffness_n_per_m(row["phi"]), row["omega_rad_s"])
        assert row["speed_m_s"] == pytest.approx(speed, rel=0.005)
        assert row["lift_m"] == pytest.approx(lift, rel=0.02)
        assert row["peak_speed_m_s"] == pytest.approx(peak, rel=0.005)
        assert row["first_step_m"] == pytest.approx(step, rel=0.005)


def test_replicates_differ_and_a_seed_repeats():
    world = draw_world(5)
    rows = direct_trials(world, [0.61], [12.0], seed=2)
    assert len({row["speed_m_s"] for row in rows}) == len({row["phi"] for row in rows}) == 3
    assert direct_trials(world, [0.61], [12.0], seed=2) == rows
    assert direct_trials(world, [0.61], [12.0], seed=3) != rows


def test_a_row_does_not_depend_on_its_neighbours():
    alone = direct_trials(null_world(), [0.62], [12.0], replicates=1, seed=1)[0]
    assert alone in direct_trials(null_world(), [0.58, 0.62], [4.0, 12.0], replicates=2, seed=1)


def test_the_noise_scale_is_the_scatter():
    scatter = []
    for scale in (0.5, 2.0):
        rows = direct_trials(with_noise(null_world(), scale), [0.58], [20.0], replicates=60)
        scatter.append(np.std([row["speed_m_s"] for row in rows], ddof=1))
    assert scatter[0] == pytest.approx(0.0025, rel=0.3)
    assert scatter[1] == pytest.approx(0.010, rel=0.3)


def test_a_trial_too_short_for_an_observable_gives_nan():
    t_s, angles, rates = (values[:100] for values in setpoints(4.0))
    short = readings(simulate(QUIET, 0.62, t_s, angles, rates, 0))
    assert np.isnan([short.speed_m_s, short.lift_m, short.peak_speed_m_s, short.first_step_m]).all()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"gait": "TROT"}, "'TROT' is not one of"),
        ({"omegas": [0.0]}, "omega_rad_s: 0.0 is outside"),
        ({"phis": [2.0]}, "phi: 2.0"),
        ({"replicates": 0}, "at least one of each"),
        ({"phis": []}, "at least one of each"),
    ],
)
def test_refusals(how, words):
    with pytest.raises(InputError) as refusal:
        direct_trials(**{"world": QUIET, "phis": [0.6], "omegas": [8.0], **how})
    assert words in str(refusal.value)
