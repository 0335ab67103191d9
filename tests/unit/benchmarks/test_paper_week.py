"""The harness of the benchmark of the paper's world in a real week."""

from types import SimpleNamespace

import numpy as np
import pytest

import nuisance
import paper_week
from sandbot_model.physics.walking import BASES


def test_every_row_has_nothing_an_effect_and_the_papers_three():
    some = list(paper_week.cases(3))
    assert len(some) == len(set(some)) == 3 * (2 * len(nuisance.NUISANCES) - 1) * 3
    for row in {(case.nuisance, case.dose) for case in some}:
        assert {case.hidden for case in some if (case.nuisance, case.dose) == row} == set(paper_week.EXTRA)


def test_a_world_has_what_the_paper_has_and_what_is_hidden_beside_it():
    case = paper_week.Case("drift", "mild", "swimming_thrust", 1)
    assert set(case.world.effects) >= {"disturbed_ground", "belly_coast", "swimming_thrust"}
    assert abs(case.world.week.k_drift) == pytest.approx(0.01)
    assert case.truth == {"swimming_thrust"}
    assert paper_week.Case("clean", "mild", paper_week.THREE, 1).truth == set(BASES["li09"])


def test_what_is_off_is_counted_in_its_own_errors():
    world = paper_week.Case("drift", "strong", "nothing", 0).world
    level_phi, stderr = np.array([0.59, 0.61]), np.array([2.0, np.nan])
    k = np.array([nuisance.usual_k(world, phi) for phi in level_phi]) + 1.0
    parameters = {name: SimpleNamespace(value=true + 0.3, stderr=0.1) for name, true in paper_week.TRUE.items()}
    fit = SimpleNamespace(parameters=parameters, level_phi=level_phi, k_n_per_m=k, k_stderr_n_per_m=stderr)
    z = nuisance.off_by(fit, paper_week.TRUE, world)
    assert z == pytest.approx(dict.fromkeys(paper_week.TRUE, 3.0) | {"k[0]": 0.5})
    some = [{"nuisance": "drift", "dose": "strong", "hidden": "nothing", "seed": 0, "outcome": "adequate", "z": z}]
    assert "| drift | strong | 1 | 1 | 0 | 1 | 0 | 0 | 0 | 0 | 0 | 0.00/0.00 | 1.00/1.00 | 0.00/0.00 |" in (
        paper_week.report(some)
    )
