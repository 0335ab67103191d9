"""A base model with a set of effects and the parameters they share: what a fit searches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sandbot_common.errors import InputError
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.robot import SANDBOT, Robot
from sandbot_model.physics.walking import BASES, V_SWIM_M_S, Params, Walker

BASE_PARAMETERS = (
    Parameter("delta_t_s", "s", 0.1, 1.2, 0.4, "time in which the body is brought to leg speed", hard_low=0.02),
    Parameter("v_swim_m_s", "m/s", 0.0, 0.05, V_SWIM_M_S, "swimming speed, the same everywhere", hard_low=0.0),
)
"""Shared by all φ levels. Li09 gives v_swim ≈ 2 cm/s; it is fitted, lest a robot that swims a little faster be
mistaken for one with a missing effect."""


@dataclass(frozen=True)
class Model:
    """``base`` is a key of ``walking.BASES``, ``effects`` come on top of it."""

    base: str
    effects: tuple[Effect, ...]
    catalogue: Mapping[str, Effect]
    robot: Robot = SANDBOT

    @cached_property
    def identifiers(self) -> tuple[str, ...]:
        """The effects on top of the base model."""
        return tuple(effect.identifier for effect in self.effects)

    @cached_property
    def walker(self) -> Walker:
        """The chain with all effects, in the order of the catalogue so that results do not depend on naming order."""
        wanted = {*BASES[self.base], *self.identifiers}
        return Walker(tuple(effect for name, effect in self.catalogue.items() if name in wanted), self.robot)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The shared parameters, those of effects named ``effect.parameter``."""
        replaced = {name for effect in self.walker.effects for name in effect.replaces}
        own = [one for one in BASE_PARAMETERS if one.name not in replaced]
        return (*own, *(one for effect in self.walker.effects for one in effect.parameters))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the shared parameters, in order."""
        replaced = {name for effect in self.walker.effects for name in effect.replaces}
        own = [one.name for one in BASE_PARAMETERS if one.name not in replaced]
        return (
            *own,
            *(f"{effect.identifier}.{one.name}" for effect in self.walker.effects for one in effect.parameters),
        )

    def arguments(self, theta: Array) -> tuple[Array, Array, Params]:
        """Δt, v_swim and the effects' parameters from values ``(..., parameters)`` in the order of ``names``."""
        values = dict(zip(self.names, np.moveaxis(theta, -1, 0), strict=True))
        params = [
            {one.name: values[f"{effect.identifier}.{one.name}"] for one in effect.parameters}
            for effect in self.walker.effects
        ]
        return values["delta_t_s"], values.get("v_swim_m_s", np.asarray(V_SWIM_M_S)), params


def model_of(base: str, effects: Sequence[str], catalogue: Mapping[str, Effect], robot: Robot | None = None) -> Model:
    """The model named. Raises InputError for an unknown base or effect, or an effect the base has already."""
    if base not in BASES:
        raise InputError(f"model {base!r} is not one of {', '.join(BASES)}")
    for name in effects:
        if name not in catalogue:
            raise InputError(f"effect {name!r} is not in the catalogue; known: {', '.join(catalogue)}")
        if name in BASES[base]:
            raise InputError(f"effect {name!r} is part of the {base} model already")
        if list(effects).count(name) > 1:
            raise InputError(f"effect {name!r} is named twice")
    chosen = set(effects)
    return Model(base, tuple(e for n, e in catalogue.items() if n in chosen), catalogue, robot or SANDBOT)
