"""The points at which a fit evaluates a chain, and how: as compiled operations (``operations``) or on arrays."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from sandbot_common.arrays import Floats, Ints
from sandbot_model.physics import machine
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.walking import Footing, Inputs, KCurve, Params, Walker

Feet = Iterable[Any]
"""The fields of a ``Footing``, arrays ``(rows, cells, nodes)``."""
Pairs = tuple[Ints, Ints, Ints]
"""Rows, cells and nodes ``(pairs,)``; of a pair of neighbouring nodes the softer one."""
CONDITIONS = ("phi", "omega", "slow_phase_ratio", "swing_ratio", "slow_begin", "slow_end")
"""Inputs of a chain that depend on the cell."""
SEEN = (*NAMES, "margin", "virgin_margin")
"""Quantities that derivatives are taken of: the observables, and the force margins [N], steady and on virgin ground."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions of the cells, arrays ``(cells,)``; φ may be ``(rows, cells)``, as may all that ``some`` returns."""

    omega: Floats
    phi: Floats
    clock: Clock
    slow_begin: Floats
    slow_end: Floats
    depths: Floats
    """Depths at which the margin is evaluated."""

    @cached_property
    def packed(self) -> Floats:
        """``CONDITIONS`` as one array ``(6, rows or 1, cells)``."""
        phi = np.atleast_2d(self.phi)
        others = (self.omega, self.clock.slow_ratio, self.clock.swing_ratio, self.slow_begin, self.slow_end)
        return np.stack([phi, *(np.broadcast_to(each, phi.shape) for each in others)])

    def some(self, row: Ints, cell: Ints) -> "Conditions":
        """The conditions of some cells, one row per cell."""

        def its(each: Floats) -> Floats:
            return (each[cell] if each.ndim == 1 else each[row, cell % each.shape[1]])[:, None]

        clock = Clock(*map(its, vars(self.clock).values()))
        return Conditions(its(self.omega), its(self.phi), clock, its(self.slow_begin), its(self.slow_end), self.depths)

    @classmethod
    def of(cls, walker: Walker, omega: Floats, phi: Floats, clock: Clock) -> "Conditions":
        """Conditions with what depends on the walker filled in."""
        return cls(omega, phi, clock, walker.slow_begin_m(clock), walker.slow_end_m(clock), walker.depths(clock))


@dataclass(frozen=True, eq=False)
class Points:
    """θ ``(rows, parameters)``, conditions of the cells, k ``(rows or 1, cells or 1, nodes)``, the curve k(φ)."""

    theta: Floats
    at: Conditions
    k: Floats
    curve: KCurve

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rows, cells, nodes."""
        return len(self.theta), self.at.omega.shape[-1], self.k.shape[2]

    @cached_property
    def packed(self) -> tuple[Floats, ...]:
        """Arguments for ``machine``: contiguous copies, so that it is compiled for one kind of array only."""
        parts = self.theta, self.at.packed, self.k, self.curve.phi, np.atleast_2d(self.curve.k_n_per_m)
        return tuple(np.array(part, dtype=float, order="C") for part in parts)


class Chains(Protocol):
    """Evaluates the chain of a model."""

    uses_phi: bool
    """Whether anything else than k depends on φ."""
    varies_phi: bool
    """Whether an effect lets φ vary along the track."""

    def footing(self, points: Points) -> Footing:
        """Where the legs hold, arrays ``(rows, cells, nodes)``."""

    def values(self, outputs: tuple[str, ...], points: Points, feet: Feet) -> Floats:
        """Some of ``SEEN`` or ``sigma_phi`` at given feet, ``(outputs, *points.shape)``."""

    def seen_moved(self, points: Points, feet: Feet, rows: int) -> Floats:
        """``SEEN`` ``(6, *points.shape)`` of points in blocks of ``rows`` rows: moved in each parameter in turn, in
        ln k, in the depth, and not at all."""

    def switches(
        self, margin: str, points: Points, pairs: Pairs, stands: Floats, window: Floats
    ) -> tuple[Pairs, Floats, Floats]:
        """Those of the pairs of nodes between which legs jump (see ``machine.switches``), depths about the maxima of
        their margins ``(pairs, 2, n)``, and where between the nodes k becomes sufficient (0 to 1)."""

    def places(self, margin: str, points: Points, pairs: Pairs, depths: Floats, rows: int) -> Floats:
        """Where k becomes sufficient for given pairs in each block of ``rows`` rows ``(blocks - 1, pairs)``; blocks as
        in ``seen_moved``, without that of the depth."""


class ArrayChains:
    """The chain evaluated by numpy, for effects that can't be recorded."""

    def __init__(self, model: Model) -> None:
        self.model, self.walker = model, model.walker
        self.varies_phi = True
        starts = [{p.name: p.start for p in effect.parameters} for effect in self.walker.effects]
        tried = Inputs(200.0, 8.0, 0.4, np.array([0.6, 0.61]), k_of_phi=KCurve(np.array([0.6, 0.61]), np.full(2, 2e2)))
        self.uses_phi = self.walker.predict(tried, starts).speed_m_s.ndim > 0

    def footing(self, points: Points) -> Footing:
        """See ``Chains``."""
        found = self.walker.footing(*self._inputs(points))
        # Copies: for read-only arrays every kernel would be compiled once more.
        return Footing(*(np.array(np.broadcast_to(part, points.shape)) for part in vars(found).values()))

    def values(self, outputs: tuple[str, ...], points: Points, feet: Feet) -> Floats:
        """See ``Chains``."""
        inputs, params = self._inputs(points)
        if outputs == ("sigma_phi",):
            return np.broadcast_to(self.walker.sigma_phi(inputs, params), (1, *points.shape))
        footing, found, margin = Footing(*feet), {}, self.walker.margin
        if "margin" in outputs:
            found["margin"] = margin(inputs, params, footing.depth, first_step=False)
        if "virgin_margin" in outputs:
            found["virgin_margin"] = margin(inputs, params, footing.virgin_depth, first_step=self.walker.remembers)
        if not found.keys() >= set(outputs):
            seen = np.broadcast_to(
                self.walker.observe(inputs, params, footing).observables, (*points.shape, len(NAMES))
            )
            found |= zip(NAMES, np.moveaxis(seen, -1, 0), strict=True)
        return np.stack([np.broadcast_to(found[name], points.shape) for name in outputs])

    def seen_moved(self, points: Points, feet: Feet, rows: int) -> Floats:  # noqa: ARG002
        """See ``Chains``."""
        return self.values(SEEN, points, feet)

    def switches(
        self, margin: str, points: Points, pairs: Pairs, stands: Floats, window: Floats
    ) -> tuple[Pairs, Floats, Floats]:
        """See ``Chains``."""
        grid = points.at.depths
        everywhere = np.broadcast_to(grid, (len(stands), 2, len(grid)))
        top, jumps = machine.tops(self._margins(margin, points, pairs, everywhere), grid, stands)
        row, cell, below = (each[jumps] for each in pairs)
        depths = machine.about(top[jumps], grid, window)
        found = self._margins(margin, points, (row, cell, below), depths)
        return (row, cell, below), depths, machine.suffices(found, depths)

    def places(self, margin: str, points: Points, pairs: Pairs, depths: Floats, rows: int) -> Floats:
        """See ``Chains``."""
        row, cell, below = pairs
        blocks = np.delete(np.arange(0, len(points.theta), rows), -2)
        found = [self._margins(margin, points, (row + first, cell, below), depths) for first in blocks]
        return np.array([machine.suffices(each, depths) for each in found])

    def _margins(self, margin: str, points: Points, pairs: Pairs, depths: Floats) -> Floats:
        """One of the margins [N] at depths ``(pairs, 2, n)`` of both nodes of each pair, of the same shape."""
        row, cell, below = pairs
        k, curve = points.k, np.atleast_2d(points.curve.k_n_per_m)
        both = k[(row % k.shape[0])[:, None], (cell % k.shape[1])[:, None], below[:, None] + (0, 1)]
        every = np.repeat(both, depths.shape[2], axis=1)[:, None]
        own = KCurve(points.curve.phi, curve[row % len(curve)], points.curve.inner)
        some = Points(points.theta[row], points.at.some(row, cell), every, own)
        depth, walks = depths.reshape(every.shape), np.ones(every.shape, dtype=bool)
        return self.values((margin,), some, (depth, walks, depth, walks)).reshape(depths.shape)

    def _inputs(self, points: Points) -> tuple[Inputs, Params]:
        at = points.at
        theta = points.theta[:, None, None, :]
        return self.model.inputs(theta, points.k, at.omega[:, None], at.phi[..., None], at.clock[:, None], points.curve)
