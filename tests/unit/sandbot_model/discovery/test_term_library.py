"""Levers and terms: each does to the chain what its words say."""

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.term_library import LEVERS, terms
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.geometry import deepest_m
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs, Walker


def test_every_term_says_in_a_formula_what_its_values_are(drawn):
    base = fit(model_of("simple", (), catalogue()), cells_of(drawn(levels=3)))
    cells, robot = base.cells, base.model.robot
    phi = cells.level_phi[cells.level]
    depth = np.nan_to_num(base.predict(phi, cells.omega).depth_m, nan=deepest_m(robot))
    inputs = Inputs(1.0, cells.omega, base.parameters["delta_t_s"].value, phi)
    for term in terms(base):
        chain = Walker().chain(inputs, (), depth[:, None], first_step=False)
        formula_effect(f"t: strength: k = {term.times('c')}; c [1] in 0..3").apply(chain, {"c": np.array(1.0)})
        np.testing.assert_allclose(np.broadcast_to(chain.k, (len(cells), 1))[:, 0], term.values, atol=1e-9)


@pytest.mark.parametrize("lever", LEVERS, ids=lambda one: one.words)
def test_every_lever_moves_what_it_says(lever):
    effect = formula_effect(f"t: {lever.stage}: {lever.assignment('c')}; c [1] in 0..0.3")
    assert effect.first_step_differs == lever.first

    def seen(c):
        found = Walker((effect,)).predict(Inputs(200.0, 10.0, 0.4, 0.61), [{"c": c}])
        swims = Walker((effect,)).predict(Inputs(100.0, 10.0, 0.4, 0.61), [{"c": c}])
        return np.array([*found.observables, swims.speed_m_s])

    changed = np.abs(seen(0.1) / seen(0.0) - 1) > 1e-6
    moved = {
        "omega *=": "1111?", "v_swim *=": "00001", "k *=": "11010", "extra_force +=": "1101?",
        "kept, peak_ratio *=": "10110", "peak_ratio *=": "00100", "kept *=": "10010",
    }[lever.formula.split("=")[0] + "="]  # fmt: skip
    moved = moved if not lever.first else "00010"
    assert all(one == "?" or bool(int(one)) == bool(there) for one, there in zip(moved, changed, strict=True)), changed
