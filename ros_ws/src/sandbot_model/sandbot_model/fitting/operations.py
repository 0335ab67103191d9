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
        steady = self._holds(points, "margin")
        return Footing(*steady, *(self._holds(points, "virgin_margin") if self.remembers else steady))

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
        at = points.packed, self._depth(margin), pairs, stands, points.at.depths, window
        found: tuple[Pairs, Array, Array] = machine.switches(*self._arranged(margin), *at)
        return found

    def places(self, margin: str, points: Points, pairs: Pairs, depths: Array, rows: int) -> Array:
        """See ``Chains``."""
        made = self._program((margin,), self._without_feet)
        return np.asarray(machine.places(made, points.packed, self._depth(margin), pairs, depths, rows))

    def _depth(self, margin: str) -> int:
        """The register of the depth that a margin is at."""
        return self.tape.inputs[FEET[0] if margin == "margin" else VIRGIN[0]]

    def _arranged(self, margin: str) -> tuple[Program, Ints, tuple[Program, int]]:
        """The program of a margin as ``machine.footing`` wants it."""

        def arranged() -> tuple[Program, Ints, tuple[Program, int]]:
            plain = self._program((margin,), self._without_feet)
            return *by_depth(plain), depth_last(plain, self._depth(margin))

        found: tuple[Program, Ints, tuple[Program, int]] = self._known(("by depth", margin), arranged)
        return found

    def _holds(self, points: Points, margin: str) -> tuple[Array, Bool]:
        of = points.packed, self._depth(margin), points.at.depths
        depth_m, walking = machine.footing(*self._arranged(margin), *of, POLISH, RISES, HELD_N)
        return depth_m.reshape(points.shape), walking.reshape(points.shape)

    def _program(self, outputs: tuple[str, ...], inputs: Mapping[str, tuple[int, int]]) -> Program:
        fixed = {} if "v_swim" in self._inputs else {"v_swim": V_SWIM_M_S}
        found: Program = self._known((outputs, len(inputs)), lambda: program(self.tape, outputs, inputs, fixed))
        return found

    def _known(self, key: Hashable, make: Callable[[], Any]) -> Any:
        if key not in self.tape.programs:
            self.tape.programs[key] = make()
        return self.tape.programs[key]
