"""Near a switch between swimming and walking, or between two depths: the fraction of a cell's trials on either side.

A quadrature node represents its part of the normal distribution of φ, so that with five nodes only 1, 23, 77 or 99 % of
the trials could walk. But the maximum of the force margin grows with k, nearly in proportion: the edge between the last
node that swims and the first that walks is put where this maximum is 0. The same is done where legs jump to another
depth, in ground that their steps disturb.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.fitting import kernels
from sandbot_model.fitting.points import Chains, Pairs, Points
from sandbot_model.physics.averaging import NODES, WEIGHTS
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Footing

EDGES = ndtri(np.cumsum(WEIGHTS)[:-1])
"""Edges [σ of k] between the parts of neighbouring nodes, away from any switch."""

DROP_M = 1e-3
"""Neighbouring nodes whose depths differ by more than this may have a switch between them."""
WINDOW = np.linspace(-2.0, 2.0, 17)
"""Depths, in grid steps about the grid's maximum of the margin, at which that maximum is refined."""


@dataclass(frozen=True)
class Switches:
    """Neighbouring nodes of a cell between which the ground begins to hold; arrays ``(switches,)``."""

    row: Ints
    cell: Ints
    below: Ints
    """The softer node of the two."""
    depths: Floats
    """Depths about the maximum of the margin [m], of the softer and the stiffer node ``(switches, 2, WINDOW)``."""
    at: Floats
    """Where k becomes sufficient [σ of k]."""

    @property
    def pairs(self) -> Pairs:
        """The pairs of nodes that enclose each switch."""
        return self.row, self.cell, self.below

    def take(self, which: Bools) -> "Switches":
        """Some of them."""
        return Switches(*(of[which] for of in vars(self).values()))


_NO = np.empty(0, dtype=np.int64)
NONE = Switches(_NO, _NO, _NO, np.empty((0, 2, len(WINDOW))), np.empty(0))
_NONE_FIXED, _NOT_AVERAGED = np.zeros(len(Observable), dtype=bool), np.zeros(len(Observable), dtype=bool)
_NOT_AVERAGED[[Observable.lift, Observable.peak_speed]] = True  # along a track (see ``averaging.node_weights``)


def switches_of(
    chains: Chains, points: Points, footing: Footing, independent: Bools, *, remembers: bool
) -> list[tuple[str, Switches]]:
    """Switches of the steady gait, and of the first step on virgin ground where that differs, with their margin's name.

    Only in cells ``independent (rows or 1, cells)``, whose replicates walk or swim independently of each other.
    """
    steady = _between(chains, points, "margin", footing.depth, footing.walking, independent)
    if not remembers:
        return [("margin", steady)]
    virgin = _between(chains, points, "virgin_margin", footing.virgin_depth, footing.virgin_walking, independent)
    # Of two switches between the same nodes the steady gait's is kept: more observables depend on it.
    taken = np.zeros((*points.shape[:2], points.shape[2] - 1), dtype=bool)
    taken[steady.row, steady.cell, steady.below] = True
    return [("margin", steady), ("virgin_margin", virgin.take(~taken[virgin.row, virgin.cell, virgin.below]))]


def share_of_nodes(found: Sequence[tuple[str, Switches]], shape: tuple[int, ...]) -> Floats:
    """The fraction of a cell's trials that each node represents ``(rows, cells, nodes)``; they add up to 1."""
    share = np.empty(shape)
    share[:] = WEIGHTS
    for _, these in found:
        kernels.shift_edges(share, EDGES, these.row, these.cell, these.below, these.at)
    return share


def add_switch_slopes(
    local: Floats,
    chains: Chains,
    points: Points,
    margin: str,
    these: Switches,
    steps: Floats,
    of: tuple[Floats, Floats, Bools],
    *,
    along_the_track: bool,
) -> None:
    """Add the derivatives due to moving switches to ``local (rows, cells, 4, parameters + 1)`` of
    ``kernels.local_jacobian``: ``points`` are blocks of rows, each with one parameter moved by ``steps``, the last
    unmoved. ``of``: values of the nodes, whitening, and which values were measured."""
    if not len(these.row):
        return
    values, whiten, measured = of
    count = local.shape[-1]
    places = chains.places(margin, points, these.pairs, these.depths, len(local))
    places = NODES[these.below] + places * (NODES[these.below + 1] - NODES[these.below])
    by = (places[:count] - places[-1]) / steps[:count, these.row]
    fixed = _NOT_AVERAGED if along_the_track else _NONE_FIXED
    kernels.add_switch_slopes(local, whiten, measured, values, these.pairs, these.at, by, fixed)


def _between(chains: Chains, points: Points, margin: str, depth: Floats, walks: Bools, independent: Bools) -> Switches:
    pairs = kernels.candidate_pairs(depth, walks, independent, DROP_M)
    if not len(pairs[0]):
        return NONE
    row, cell, below = pairs
    pairs, depths, part = chains.switches(margin, points, pairs, depth[row, cell, below + 1], WINDOW)
    below = pairs[2]
    return Switches(*pairs, depths, NODES[below] + part * (NODES[below + 1] - NODES[below]))
