"""Pressing a leg into the lab's ground."""

import csv

import numpy as np
import pytest
from rig import QUIET, with_effect

from sandbot_common.errors import InputError
from sandbot_lab.penetrometer import press
from sandbot_lab.tools.penetrometer import main


def test_linear_ground_gives_k_times_depth():
    rows = press(QUIET, [0.6, 0.62], [0.02, 0.04], sd=0.0)
    forces = [QUIET.stiffness_n_per_m(phi) * depth for phi in (0.6, 0.62) for depth in (0.02, 0.04)]
    assert [row["force_n"] for row in rows] == pytest.approx(forces, rel=1e-9)


def test_cohesion_is_an_offset():
    plain, sticky = (press(world, [0.6], sd=0.0) for world in (QUIET, with_effect("cohesion", c_pa=300.0)))
    gaps = [two["force_n"] - one["force_n"] for one, two in zip(plain, sticky, strict=True)]
    assert gaps == pytest.approx([2 * 300 * 0.012 * 0.0355] * len(gaps), rel=1e-9)


def test_the_sensor_scatters_as_it_says():
    rows = press(QUIET, np.linspace(0.58, 0.633, 200), [0.03], seed=1, sd=0.02)
    pulls = [(row["force_n"] - QUIET.stiffness_n_per_m(row["phi"]) * 0.03) / row["force_sd_n"] for row in rows]
    assert np.std(pulls) == pytest.approx(1.0, abs=0.15)
    assert rows == press(QUIET, np.linspace(0.58, 0.633, 200), [0.03], seed=1, sd=0.02)


def test_depths_out_of_reach_and_impossible_beds_are_refused():
    for phi, depth in ((0.6, 0.05), (0.6, 0.0), (0.9, 0.03)):
        with pytest.raises(InputError):
            press(QUIET, [phi], [depth])


def test_the_command_writes_a_table_or_nothing(tmp_path):
    path = tmp_path / "readings.csv"
    assert main(["--phi", "0.58", "0.6", "--out", str(path)]) == 0
    with path.open() as file:
        assert len(list(csv.DictReader(file))) == 8
    assert main(["--phi", "0.58", "2", "--out", str(tmp_path / "other.csv")]) == 2
    assert not (tmp_path / "other.csv").exists()
