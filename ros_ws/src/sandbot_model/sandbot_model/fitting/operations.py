"""The chain of a model as operations (``physics.tape``), executed where a fit wants them."""

from collections.abc import Callable, Hashable, Mapping
from typing import Any

import numpy as np

from sandbot_model.fitting.points import CONDITIONS, Feet, Pairs, Points
from sandbot_model.physics import machine
from sandbot_model.physics.arrays import Array, Bool, Ints
from sandbot_model.physics.machine import OF_CELL, OF_FEET, OF_NODE, OF_ROW
from sandbot_model.physics.model import Model
from sandbot_model.physics.tape import FEET, VIRGIN, Program, Tape, by_depth, depth_last, program
from sandbot_model.physics.walking import HELD_N, POLISH, RISES, V_SWIM_M_S, Footing

BASE = {"delta_t": "delta_t_s", "v_swim": "v_swim_m_s"}
"""Inputs that are parameters of the base model, and these."""


class CompiledChains:
    """A chain whose effects could all be recorded; see ``points.Chains``."""

    def __init__(self, model: Model, tape: Tape) -> None:
        self.tape, self.remembers = tape, model.walker.remembers
        self.varies_phi = tape.outputs["sigma_phi"] not in tape.constants.values()
        self.uses_phi = any(tape.inputs["phi"] in line[2:] for line in tape.code)
        parameters = [BASE.get(name, name) for name in tape.inputs]
        self._inputs = {
            **{
                n: (OF_ROW, model.names.index(p))
                for n, p in zip(tape.inputs, parameters, strict=True)
                if p in model.names
            },
            **{name: (OF_CELL, at) for at, name in enumerate(CONDITIONS)},
            **{name: (OF_FEET, at) for at, name in enumerate((*FEET, *VIRGIN))},
            "k": (OF_NODE, 0),
        }
        # The depth is what is searched for, no input.
        self._without_feet = {name: of for name, of in self._inputs.items() if of[0] != OF_FEET}

    def footing(self, points: Points) -> Footing:
        """See ``Chains``."""
        steady = self._holds(points, FEET[0], "margin")
        return Footing(*steady, *(self._holds(points, VIRGIN[0], "virgin_margin") if self.remembers else steady))

    def values(self, outputs: tuple[str, ...], points: Points, feet: Feet) -> Array:
        """See ``Chains``."""
        made = self._program(outputs, self._inputs)
        rows, cells, nodes = points.shape
        at = np.array([*feet], dtype=float).reshape(-1, rows, cells * nodes)
        return np.asarray(machine.evaluate(made, points.packed, at).reshape(-1, rows, cells, nodes))

    def switches(
        self, margin: str, points: Points, pairs: Pairs, stands: Array, window: Array
    ) -> tuple[Pairs, Array, Array]:
        """See ``Chains``."""
        found: tuple[Pairs, Array, Array] = machine.switches(
            *self._searched(margin, points), pairs, stands, points.at.depths, window
        )
        return found

    def places(self, margin: str, points: Points, pairs: Pairs, depths: Array, rows: int) -> Array:
        """See ``Chains``."""
        return np.asarray(machine.places(*self._searched(margin, points), pairs, depths, rows))

    def _searched(self, margin: str, points: Points) -> tuple[Program, tuple[Array, ...], int]:
        """The program of a margin, where it is evaluated, and the register of the depth."""
        depth = self.tape.inputs[FEET[0] if margin == "margin" else VIRGIN[0]]
        return self._program((margin,), self._without_feet), points.packed, depth

    def _holds(self, points: Points, depth: str, margin: str) -> tuple[Array, Bool]:
        at, grid = self.tape.inputs[depth], points.at.depths

        def arranged() -> tuple[Program, Ints, tuple[Program, int]]:
            plain = self._program((margin,), self._without_feet)
            return *by_depth(plain), depth_last(plain, at)

        programs = self._known(("by depth", margin), arranged)
        depth_m, walking = machine.footing(*programs, points.packed, at, grid, POLISH, RISES, HELD_N)
        return depth_m.reshape(points.shape), walking.reshape(points.shape)

    def _program(self, outputs: tuple[str, ...], inputs: Mapping[str, tuple[int, int]]) -> Program:
        fixed = {} if "v_swim" in self._inputs else {"v_swim": V_SWIM_M_S}
        found: Program = self._known((outputs, len(inputs)), lambda: program(self.tape, outputs, inputs, fixed))
        return found

    def _known(self, key: Hashable, make: Callable[[], Any]) -> Any:
        if key not in self.tape.programs:
            self.tape.programs[key] = make()
        return self.tape.programs[key]
