"""Trials drawn from the project's own model: known truth for fits (the blind truth is in tests/hidden)."""

import dataclasses

import numpy as np
import pytest

import _drawn
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Walker

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}


def draw(
    effects=(), *, seed=0, levels=5, omega=(4, 8, 12, 16, 20, 24, 30), replicates=3, noise=1.0, values=None, formulas=()
):
    """A trials table; ``values`` are parameters by effect, each at its start otherwise. ``formulas`` act as well."""
    known = (effect for name, effect in EFFECTS.items() if name in effects)
    walker = Walker((*known, *map(formula_effect, formulas)))
    params = [
        {**{p.name: p.start for p in e.parameters}, **(values or {}).get(e.identifier, {})} for e in walker.effects
    ]
    return _drawn.drawn(walker, params, np.linspace(0.58, 0.633, levels), omega, replicates, seed, noise)


@pytest.fixture(scope="session")
def drawn():
    return draw


@pytest.fixture(scope="session")
def two_gaits():
    """A fit to trials of HGCS at 6 rad/s, and of SGCS at two frequencies, that minds the rate of the slow phase."""
    trials = draw(levels=2, omega=(6, 10, 14))
    trials = dataclasses.replace(trials, gait=np.where(trials.omega_rad_s == 6, "HGCS", "SGCS"))
    base = fit(model_of("simple", (), EFFECTS), cells_of(trials))
    model = model_of("simple", ("slow_phase_speed",), EFFECTS)
    return fitted_at(model, base.cells, dataclasses.replace(base.point, theta=np.append(base.point.theta, 0.9)))


@pytest.fixture(scope="session")
def smooth():
    """A fit to trials none of which swims: the deviance is a parabola in all its unknowns."""
    cells = cells_of(draw(seed=2, omega=(4, 6, 8, 10)))
    walking = cells.without(np.flatnonzero(cells.level_phi[cells.level] < 0.59))
    return fit(model_of("simple", (), EFFECTS), walking)
