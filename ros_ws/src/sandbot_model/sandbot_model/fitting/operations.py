"""The chain of a model as a list of operations (``physics.tape``), evaluated at the points of a fit."""

from collections.abc import Callable, Hashable, Mapping
from typing import Any

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.fitting import kernels
from sandbot_model.fitting.points import CONDITIONS, SEEN, Feet, Pairs, Points
from sandbot_model.fitting.switch import DROP_M, EDGES, WINDOW
from sandbot_model.physics import machine
from sandbot_model.physics.averaging import NODES, WEIGHTS
from sandbot_model.physics.machine import OF_CELL, OF_FEET, OF_NODE, OF_ROW
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.tape import FEET, VIRGIN, Moved, Program, Tape, by_depth, depth_last, moved, program
from sandbot_model.physics.walking import HELD_N, POLISH, RISES, V_SWIM_M_S, Footing

BASE = {"delta_t": "delta_t_s", "v_swim": "v_swim_m_s"}
"""Inputs of the tape that are parameters of the base model, and the names of these."""

FOOTING_SEARCH = POLISH, RISES, HELD_N, DROP_M, WINDOW
"""Settings of the search for a footing and for jumps of the legs (see ``walking`` and ``switch``)."""


class CompiledChains:
    """A chain whose effects could all be recorded; see ``points.Chains``."""

    def __init__(self, model: Model, tape: Tape) -> None:
        self.tape, self.remembers = tape, model.walker.remembers
        self.varies_phi = tape.outputs["sigma_phi"] not in tape.constants.values()
        self.uses_phi = any(tape.inputs["phi"] in line[2:] for line in tape.code)
        self._count = len(model.names)
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
        # The depth is searched for: it is no input.
        self._without_feet = {name: of for name, of in self._inputs.items() if of[0] != OF_FEET}

    def footing(self, points: Points) -> Footing:
        """See ``Chains``."""
        steady = self._holds(points, "margin")
        return Footing(*steady, *(self._holds(points, "virgin_margin") if self.remembers else steady))

    def values(self, outputs: tuple[str, ...], points: Points, feet: Feet) -> Floats:
        """See ``Chains``."""
        made = self._program(outputs, self._inputs)
        rows, cells, nodes = points.shape
        at = np.array([*feet], dtype=float).reshape(-1, rows, cells * nodes)
        return np.asarray(machine.evaluate(made, points.packed, at).reshape(-1, rows, cells, nodes))

    def footing_and_values(self, points: Points, independent: Bools) -> tuple[Footing, Floats, Floats]:
        """Footing, the observables there ``(4, *points.shape)``, and the fraction of a cell's trials that each node
        represents; in cells ``independent (rows or 1, cells)`` trials walk or swim independently of each other."""
        virgin = "virgin_margin" if self.remembers else "margin"
        of = self._of_switches("margin"), self._of_switches(virgin), self._program(NAMES, self._inputs)
        at = points.packed, points.at.depths, np.ascontiguousarray(independent)
        *feet, values, share = kernels.footing_and_values(*of, *at, FOOTING_SEARCH, (NODES, WEIGHTS, EDGES))
        return Footing(*(each.reshape(points.shape) for each in feet)), values.reshape(-1, *points.shape), share

    def seen_moved(self, points: Points, feet: Feet, rows: int) -> Floats:
        """See ``Chains``."""
        made = self._program(SEEN, self._inputs)
        repeated: Moved = self._cached(("moved", SEEN), lambda: moved(made, self._moves))
        at = np.array([*feet], dtype=float).reshape(-1, len(points.theta), points.shape[1] * points.shape[2])
        return np.asarray(machine.evaluate_moved(made, repeated, points.packed, at, rows).reshape(-1, *points.shape))

    @property
    def _moves(self) -> list[set[int]]:
        """The registers that change with each parameter, with ln k and with the depth."""
        k, register = self.tape.inputs["k"], self.tape.inputs.items()
        of_theta = [{at for name, at in register if self._inputs.get(name) == (OF_ROW, p)} for p in range(self._count)]
        # A spread of φ along the track is a spread of k.
        of_theta = [registers | {k} for registers in of_theta] if self.varies_phi else of_theta
        return [*of_theta, {k}, {self.tape.inputs[FEET[0]], self.tape.inputs[VIRGIN[0]]}]

    def switches(
        self, margin: str, points: Points, pairs: Pairs, stands: Floats, window: Floats
    ) -> tuple[Pairs, Floats, Floats]:
        """See ``Chains``."""
        *of, depth = self._of_switches(margin)
        at = points.packed, depth, pairs, stands, points.at.depths, window
        found: tuple[Pairs, Floats, Floats] = machine.switches(*of, *at)
        return found

    def _of_switches(self, margin: str) -> Any:
        """The programs of a margin as ``machine.switches`` wants them, and the register of its depth."""

        def made() -> Any:
            return *self._arranged(margin), moved(self._margin(margin), []), self._depth(margin)

        return self._cached(("switches", margin), made)

    def places(self, margin: str, points: Points, pairs: Pairs, depths: Floats, rows: int) -> Floats:
        """See ``Chains``."""
        made = self._margin(margin)
        # The depths are given: everything else is moved.
        repeated: Moved = self._cached(("moved", margin), lambda: moved(made, self._moves[:-1]))
        return np.asarray(machine.places(made, repeated, points.packed, self._depth(margin), pairs, depths, rows))

    def _margin(self, margin: str) -> Program:
        return self._program((margin,), self._without_feet)

    def _depth(self, margin: str) -> int:
        """The register of a margin's depth."""
        return self.tape.inputs[FEET[0] if margin == "margin" else VIRGIN[0]]

    def _arranged(self, margin: str) -> tuple[Program, Ints, tuple[Program, int]]:
        """The program of a margin as ``machine.footing`` wants it."""

        def arranged() -> tuple[Program, Ints, tuple[Program, int]]:
            plain = self._margin(margin)
            return *by_depth(plain), depth_last(plain, self._depth(margin))

        found: tuple[Program, Ints, tuple[Program, int]] = self._cached(("by depth", margin), arranged)
        return found

    def _holds(self, points: Points, margin: str) -> tuple[Floats, Bools]:
        of = points.packed, self._depth(margin), points.at.depths
        depth_m, walking = machine.footing(*self._arranged(margin), *of, POLISH, RISES, HELD_N)
        return depth_m.reshape(points.shape), walking.reshape(points.shape)

    def _program(self, outputs: tuple[str, ...], inputs: Mapping[str, tuple[int, int]]) -> Program:
        fixed = {} if "v_swim" in self._inputs else {"v_swim": V_SWIM_M_S}
        found: Program = self._cached((outputs, len(inputs)), lambda: program(self.tape, outputs, inputs, fixed))
        return found

    def _cached(self, key: Hashable, make: Callable[[], Any]) -> Any:
        if key not in self.tape.programs:
            self.tape.programs[key] = make()
        return self.tape.programs[key]
