"""Trials drawn from the project's own model: known truth for fits (the blind truth is in tests/hidden)."""

import numpy as np
import pytest

from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.observables import COLUMNS
from sandbot_model.physics.walking import Inputs, KCurve, Walker
from sandbot_record.trials.table import Row, from_rows

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
CURVE = KCurve(np.array([0.58, 0.6, 0.633]), np.array([170.0, 205.0, 220.0]))
NOISE = np.array([0.005, 0.0004, 0.006, 0.001])


def draw(
    effects=(), *, seed=0, levels=5, omega=(4, 8, 12, 16, 20, 24, 30), replicates=3, noise=1.0, values=None, formulas=()
):
    """A trials table; ``values`` are parameters by effect, each at its start otherwise. ``formulas`` act as well."""
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(
        np.linspace(0.58, 0.633, levels), np.array(omega, dtype=float), np.arange(replicates), indexing="ij"
    )
    phi, frequency, replicate = (axis.ravel() for axis in grid)
    true = phi + rng.normal(0.0, 6e-4, phi.shape)
    known = (effect for name, effect in EFFECTS.items() if name in effects)
    walker = Walker((*known, *map(formula_effect, formulas)))
    params = [
        {**{p.name: p.start for p in e.parameters}, **(values or {}).get(e.identifier, {})} for e in walker.effects
    ]
    seen = walker.predict(Inputs(CURVE(true), frequency, 0.4, true, k_of_phi=CURVE), params).observables
    seen = seen + noise * NOISE * rng.normal(size=seen.shape)
    return from_rows(
        [
            Row(
                trial_id=f"t{i}",
                phi=float(true[i]),
                omega_rad_s=float(frequency[i]),
                gait="UNIFORM",
                replicate=float(replicate[i]),
                **dict(zip(COLUMNS, map(float, seen[i]), strict=True)),
            )
            for i in range(len(phi))
        ]
    )


@pytest.fixture(scope="session")
def drawn():
    return draw
