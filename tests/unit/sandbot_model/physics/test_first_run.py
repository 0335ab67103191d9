"""The first run of an effect: what the project has itself passes it."""

import numpy as np
import pytest

from sandbot_model.physics.effect import Effect
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.first_run import changes_something, is_repeatable, vanishes
from sandbot_model.physics.variants import variants_of

EVERY = [*CATALOGUE, *(variant for effect in CATALOGUE for variant in variants_of(effect))]


NEVER_ABSENT = {
    "slow_phase_speed",
    "slow_phase_speed no stance cut short by the next leg",
    "unequal_leg_load a step is the mean of its legs'",
}
"""Conventions of which the base model is no special case: legs also turn by the clock of the gait, or swim.
"""


class Idle(Effect):
    identifier, stage, formula, source, seen_in = "idle", "strength", "-", "-", "-"

    def apply(self, chain, p):
        chain.k = chain.k * 1.0


@pytest.mark.filterwarnings("ignore:divide by zero|overflow|invalid value")
@pytest.mark.parametrize("effect", EVERY, ids=lambda effect: f"{effect.identifier} {effect.variant}".strip())
def test_the_whole_catalogue_changes_something_in_all_its_conventions(effect):
    assert changes_something(effect)
    assert is_repeatable(effect)
    assert vanishes(effect) == (f"{effect.identifier} {effect.variant}".strip() not in NEVER_ABSENT)


def test_an_effect_that_leaves_all_as_it_is_changes_nothing():
    assert not changes_something(Idle())


def test_its_arrays_are_shaped_as_those_of_a_fit():
    shapes = {}

    class Looking(Idle):
        def apply(self, chain, p):
            shapes.update({name: np.shape(getattr(chain, name)) for name in ("k", "omega", "phi", "slow_begin")})

    changes_something(Looking())
    assert shapes == {"k": (1, 1, 2, 1), "omega": (1, 12, 1, 1), "phi": (1, 12, 1, 1), "slow_begin": (12, 1, 1)}
