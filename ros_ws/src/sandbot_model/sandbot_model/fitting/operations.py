"""The chain of a model as operations (``physics.tape``), executed where a fit wants them."""

import numpy as np

from sandbot_model.fitting.points import Feet, Points
from sandbot_model.physics import machine
from sandbot_model.physics.arrays import Array, Bool, Ints
from sandbot_model.physics.model import Model
from sandbot_model.physics.tape import FEET, VIRGIN, Program, Tape, program
from sandbot_model.physics.walking import HELD_N, POLISH, RISES, V_SWIM_M_S, Footing

CELLS = ("omega", "phi", "slow_phase_ratio", "swing_ratio", "slow_begin")
"""Inputs that depend on the cell."""
BASE = {"delta_t": "delta_t_s", "v_swim": "v_swim_m_s"}
"""Inputs that are parameters of the base model, and these."""


class CompiledChains:
    """A chain whose effects could all be recorded; see ``points.Chains``."""

    def __init__(self, model: Model, tape: Tape) -> None:
        self.tape, self.remembers = tape, model.walker.remembers
        self.varies_phi = tape.outputs["sigma_phi"] not in tape.constants.values()
        self.uses_phi = any(tape.inputs["phi"] in line[2:] for line in tape.code)
        self._column = {name: column for column, name in enumerate(model.names)}
        self._column |= {short: self._column[name] for short, name in BASE.items() if name in self._column}
        self._plain: dict[tuple[str, ...], tuple[Program, list[str]]] = {}
        self._sorted: dict[str, tuple[Program, Ints]] = {}
        self._places: dict[tuple[object, ...], Ints] = {}

    def footing(self, points: Points) -> Footing:
        """See ``Chains``."""
        steady = self._crossing(points, FEET[0], "margin")
        return Footing(*steady, *(self._crossing(points, VIRGIN[0], "virgin_margin") if self.remembers else steady))

    def values(self, outputs: tuple[str, ...], points: Points, feet: Feet) -> Array:
        """See ``Chains``."""
        made, names = self._program(outputs)
        at = self._at(names, points)
        found = machine.evaluate(made, points.shape, at, _flat(points, feet), _curve(points))
        return np.asarray(found.reshape(len(outputs), *points.shape))

    def _crossing(self, points: Points, depth: str, margin: str) -> tuple[Array, Bool]:
        plain, names = self._program((margin,))
        if margin not in self._sorted:
            level = dict.fromkeys(self.tape.inputs, 1) | dict.fromkeys(CELLS, 2) | {"k": 3, depth: 0}
            self._sorted[margin] = program(self.tape, (margin,), level)[:2]
        scan, levels = self._sorted[margin]
        at, register = self._at([name for name in names if name != depth], points), self.tape.inputs[depth]
        flat, curve, grid = _flat(points, ()), _curve(points), points.at.depths
        found, peak = machine.bracket(scan, levels, points.shape, at, flat, curve, register, grid)
        common = plain, points.shape, at, flat, curve, register, grid
        depth_m, walking = machine.polish(*common, *found, POLISH), found[0] > 0
        if peak[0].any():
            reaches, rise = machine.follow(*common, *peak, RISES, HELD_N)
            depth_m, walking = np.where(reaches, rise, depth_m), walking | reaches
        return depth_m.reshape(points.shape), walking.reshape(points.shape)

    def _program(self, outputs: tuple[str, ...]) -> tuple[Program, list[str]]:
        if outputs not in self._plain:
            made, _, names = program(self.tape, outputs, {})
            self._plain[outputs] = made, names
        return self._plain[outputs]

    def _at(self, names: list[str], points: Points) -> Ints:
        """Register of each input, its offset in ``_flat``, and its strides over rows, cells and nodes."""
        key = (*names, points.theta.shape, points.at.phi.shape, points.k.shape)
        if key not in self._places:
            self._places[key] = np.array([self._place(name, points) for name in names], dtype=np.int64).reshape(-1, 5)
        return self._places[key]

    def _place(self, name: str, points: Points) -> tuple[int, ...]:
        rows, cells, nodes = points.shape
        begin_cells = 1 + points.theta.size
        begin_k = begin_cells + (len(CELLS) - 1) * cells + points.at.phi.size
        begin_feet = begin_k + points.k.size
        register = self.tape.inputs[name]
        if name == "k":
            of_rows, of_cells, _ = points.k.shape
            return register, begin_k, (of_rows > 1) * of_cells * nodes, (of_cells > 1) * nodes, 1
        if name == "phi":
            return register, begin_k - points.at.phi.size, cells * (points.at.phi.ndim > 1), 1, 0
        if name in CELLS:
            return register, begin_cells + [one for one in CELLS if one != "phi"].index(name) * cells, 0, 1, 0
        if name in (*FEET, *VIRGIN):
            place = (*FEET, *VIRGIN).index(name)
            return register, begin_feet + place * rows * cells * nodes, cells * nodes, nodes, 1
        if name in self._column:
            return register, 1 + self._column[name], points.theta.shape[1], 0, 0
        return register, 0, 0, 0, 0


def _flat(points: Points, feet: Feet) -> Array:
    """All inputs in one piece; the first is the swimming speed where no parameter is."""
    at, clock = points.at, points.at.clock
    cells = (at.omega, clock.slow_ratio, clock.swing_ratio, at.slow_begin, at.phi)
    return np.concatenate([[V_SWIM_M_S], *(part.ravel() for part in (points.theta, *cells, points.k, *feet))])


def _curve(points: Points) -> tuple[Array, Array]:
    return points.curve.phi, np.atleast_2d(points.curve.k_n_per_m)
