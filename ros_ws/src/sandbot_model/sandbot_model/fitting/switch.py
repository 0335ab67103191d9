"""Beside a switch: which share of a cell's trials walks, or walks another way.

A node stands for its part of the normal distribution of φ, and of five nodes 1, 23, 77 or 99 % walk. But the most the
margin comes to grows with k, nearly in proportion: where it is 0 between the last node that swims and the first that
walks, the parts of the two meet. So where legs come to hold at another depth, in ground that their steps disturb.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from sandbot_model.fitting import kernels
from sandbot_model.fitting.points import Chains, Pairs, Points
from sandbot_model.physics.arrays import Array, Bool, Ints
from sandbot_model.physics.averaging import NODES, WEIGHTS
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Footing

EDGES = ndtri(np.cumsum(WEIGHTS)[:-1])
"""Where the parts of neighbouring nodes meet, away from any switch."""

DROP_M = 1e-3
"""Neighbouring nodes of which one stands deeper by more are looked at."""
WINDOW = np.linspace(-2.0, 2.0, 17)
"""Depths about the highest place on the grid, in its steps, that say how high a margin rises there."""


@dataclass(frozen=True)
class Switches:
    """Neighbouring nodes of a cell between which the ground begins to hold; arrays ``(switches,)``."""

    row: Ints
    cell: Ints
    below: Ints
    """The softer node of the two."""
    depths: Array
    """About where the margin is highest [m], of the softer node and of the stiffer ``(switches, 2, WINDOW)``."""
    at: Array
    """Where k begins to suffice [σ of k]."""

    @property
    def pairs(self) -> Pairs:
        """The nodes that they are between."""
        return self.row, self.cell, self.below

    def take(self, which: Bool) -> "Switches":
        """Some of them."""
        return Switches(*(of[which] for of in vars(self).values()))


_NO = np.empty(0, dtype=np.int64)
NONE = Switches(_NO, _NO, _NO, np.empty((0, 2, len(WINDOW))), np.empty(0))
_AVERAGED, _SPARED = np.zeros(len(Observable), dtype=bool), np.zeros(len(Observable), dtype=bool)
_SPARED[[Observable.lift, Observable.peak_speed]] = True  # along a track these are no averages (see ``node_weights``)


def switches_of(
    chains: Chains, points: Points, footing: Footing, apart: Bool, *, remembers: bool
) -> list[tuple[str, Switches]]:
    """Those of the steady gait, and of the first step on virgin ground where that differs, by their margin.

    Of cells ``apart (rows or 1, cells)``, whose replicates walk or swim each by itself.
    """
    steady = _between(chains, points, "margin", footing.depth, footing.walking, apart)
    if not remembers:
        return [("margin", steady)]
    virgin = _between(chains, points, "virgin_margin", footing.virgin_depth, footing.virgin_walking, apart)
    # Of two between the same nodes the steady gait's is the one that more observables see.
    taken = np.zeros((*points.shape[:2], points.shape[2] - 1), dtype=bool)
    taken[steady.row, steady.cell, steady.below] = True
    return [("margin", steady), ("virgin_margin", virgin.take(~taken[virgin.row, virgin.cell, virgin.below]))]


def share_of_nodes(found: Sequence[tuple[str, Switches]], shape: tuple[int, ...]) -> Array:
    """The share of a cell's trials that each node stands for ``(rows, cells, nodes)``; their sum is 1."""
    share = np.empty(shape)
    share[:] = WEIGHTS
    for _, these in found:
        kernels.hand_over(share, EDGES, these.row, these.cell, these.below, these.at)
    return share


def turn(
    local: Array,
    chains: Chains,
    points: Points,
    margin: str,
    these: Switches,
    steps: Array,
    of: tuple[Array, Array, Bool],
    *,
    along_the_track: bool,
) -> None:
    """Add to ``local (rows, cells, 4, parameters + 1)``, see ``kernels.local_jacobian``, what the same switches do that
    move: ``points`` are blocks of rows, each with one parameter moved by ``steps``, the last with none. ``of``: values
    of the nodes, whitening, and what was measured."""
    if not len(these.row):
        return
    values, whiten, measured = of
    count = local.shape[-1]
    places = chains.places(margin, points, these.pairs, these.depths, len(local))
    places = NODES[these.below] + places * (NODES[these.below + 1] - NODES[these.below])
    by = (places[:count] - places[-1]) / steps[:count, these.row]
    spared = _SPARED if along_the_track else _AVERAGED
    kernels.turn(local, whiten, measured, values, these.pairs, these.at, by, spared)


def _between(chains: Chains, points: Points, margin: str, depth: Array, walks: Bool, apart: Bool) -> Switches:
    pairs = kernels.apart(depth, walks, apart, DROP_M)
    if not len(pairs[0]):
        return NONE
    row, cell, below = pairs
    pairs, depths, part = chains.switches(margin, points, pairs, depth[row, cell, below + 1], WINDOW)
    below = pairs[2]
    return Switches(*pairs, depths, NODES[below] + part * (NODES[below + 1] - NODES[below]))
