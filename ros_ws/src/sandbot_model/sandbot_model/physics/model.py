"""A base model with a set of effects, and the parameters shared by all φ levels."""

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_common.suggest import did_you_mean
from sandbot_model.physics.effect import Effect, Parameter, is_from_catalogue, of_robot
from sandbot_model.physics.gait import EVEN, Clock, slow_phase_ratio
from sandbot_model.physics.geometry import froude_speed_m_s
from sandbot_model.physics.walking import BASES, V_SWIM_M_S, Inputs, Params, Walker

if TYPE_CHECKING:
    from sandbot_model.physics.tape import Tape

BASE_PARAMETERS = (
    Parameter("delta_t_s", "s", 0.1, 1.2, 0.4, "time in which the body is brought to leg speed", hard_low=0.02),
    Parameter(
        "v_swim_m_s",
        "m/s",
        0.0,
        0.05,
        V_SWIM_M_S,
        "swimming speed, the same everywhere",
        hard_low=0.0,
        scales_with=froude_speed_m_s,
    ),
)
"""Shared by all φ levels. Li09 gives v_swim ≈ 2 cm/s; it is fitted so that a robot that swims a little faster is not
mistaken for one with a missing effect."""

SLOWEST = round(slow_phase_ratio("HGCS"), 2)
"""Leg rate in a slow phase over the mean rate (β of HGCS): the factor by which Δt may be shorter if legs push in it."""


@dataclass(frozen=True)
class Model:
    """``base`` is a key of ``walking.BASES``, to which ``effects`` are added."""

    base: str
    effects: tuple[Effect, ...]
    catalogue: Mapping[str, Effect]
    robot: Robot = SANDBOT
    held: Mapping[str, float] = field(default_factory=dict)
    """Values of shared parameters that are held and not fitted, by their names in ``names``."""

    def __getstate__(self) -> dict[str, object]:
        """Cached properties are not pickled."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

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
    def tape(self) -> "Tape | None":
        """The chain as operations; None where an effect can't be recorded."""
        # Imported here: commands that fit nothing do not wait for the compiler.
        from sandbot_model.physics.tape import record, recorded

        walker = self.walker
        # Recordings of a user's effect are not cached: it may change between two models.
        cached = all(map(is_from_catalogue, walker.effects))
        return recorded(pickle.dumps((walker.effects, walker.robot))) if cached else record(walker)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The shared parameters in the order of ``names``; the range of a held one is its value."""
        return tuple(
            parameter.held_at(self.held[name]) if name in self.held else parameter
            for name, parameter in self._by_name.items()
        )

    def parameter(self, name: str) -> Parameter:
        """A shared parameter by name. Raises InputError if the model has none of that name."""
        if name not in self.names:
            raise InputError(f"the model has no parameter {name!r}{did_you_mean(name, self.names)}")
        return self.parameters[self.names.index(name)]

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper ends of the search ranges, ``(parameters,)`` each."""
        low, high = zip(*(parameter.search for parameter in self.parameters), strict=True)
        return np.array(low), np.array(high)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the shared parameters, those of effects ``effect.parameter``."""
        return tuple(self._by_name)

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        effects = self.walker.effects
        replaced = {name for effect in effects for name in effect.replaces}
        base = {own.name: own.of(self.robot) for own in BASE_PARAMETERS if own.name not in replaced}
        if any(effect.at_the_slow_rate for effect in effects):
            usual = base["delta_t_s"]
            base["delta_t_s"] = replace(usual, low=SLOWEST * usual.low)
        return base | {
            f"{effect.identifier}.{parameter.name}": parameter for effect in effects for parameter in effect.parameters
        }

    def arguments(self, theta: Floats) -> tuple[Floats, Floats, Params]:
        """Δt, v_swim and the effects' parameters from values ``(..., parameters)`` in the order of ``names``."""
        values = dict(zip(self.names, np.moveaxis(theta, -1, 0), strict=True))
        params = [
            {parameter.name: values[f"{effect.identifier}.{parameter.name}"] for parameter in effect.parameters}
            for effect in self.walker.effects
        ]
        return values["delta_t_s"], values.get("v_swim_m_s", np.asarray(V_SWIM_M_S)), params

    def inputs(
        self,
        theta: Floats,
        k_n_per_m: ArrayLike,
        omega_rad_s: ArrayLike,
        phi: ArrayLike,
        clock: Clock = EVEN,
        k_of_phi: Callable[[Floats], Floats] | None = None,
    ) -> tuple[Inputs, Params]:
        """The walker's arguments for conditions and shared parameters ``theta (..., parameters)``.

        The leading axes of θ broadcast against the conditions.
        """
        delta_t, v_swim, params = self.arguments(theta)
        return Inputs(k_n_per_m, omega_rad_s, delta_t, phi, v_swim, clock, k_of_phi), params


def model_of(
    base: str,
    effects: Sequence[str],
    catalogue: Mapping[str, Effect],
    robot: Robot | None = None,
    held: Mapping[str, float] | None = None,
) -> Model:
    """The model with these effects, in any order. Raises InputError for an unknown base or effect, an effect that the
    base already has, or a held parameter that the model does not have.
    """
    if base not in BASES:
        raise InputError(f"model {base!r} is not one of {', '.join(BASES)}")
    for name in effects:
        if name not in catalogue:
            raise InputError(f"effect {name!r} is not in the catalogue{did_you_mean(name, catalogue)}")
        if name in BASES[base]:
            raise InputError(f"effect {name!r} is part of the {base} model already")
        if list(effects).count(name) > 1:
            raise InputError(f"effect {name!r} is named twice")
    robot = robot or SANDBOT
    catalogue = of_robot(catalogue, robot)
    chosen = tuple(effect for name, effect in catalogue.items() if name in effects)
    model = Model(base, chosen, catalogue, robot, held or {})
    for name in model.held:
        if name not in model.names:
            raise InputError(f"{name!r} is held but no parameter of the model{did_you_mean(name, model.names)}")
    return model
