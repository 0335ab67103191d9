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
from sandbot_model.fitting.averaging import NODES, WEIGHTS
from sandbot_model.fitting.points import Chains, Pairs, Points
from sandbot_model.physics.arrays import Array, Bool, Ints
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

    def take(self, which: Bool) -> "Switches":
        """Some of them."""
        return Switches(*(of[which] for of in vars(self).values()))


_NO = np.empty(0, dtype=np.int64)
NONE = Switches(_NO, _NO, _NO, np.empty((0, 2, len(WINDOW))), np.empty(0))


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


def moved_switches(chains: Chains, points: Points, margin: str, these: Switches, rows: int) -> Array:
    """Where the same switches are in each of several blocks of ``rows`` rows ``(blocks, switches)``."""
    blocks = len(points.theta) // rows
    if not len(these.row):
        return np.empty((blocks, 0))
    row = (np.arange(blocks)[:, None] * rows + these.row).ravel()
    pairs = row, np.tile(these.cell, blocks), np.tile(these.below, blocks)
    return _place(chains, points, margin, pairs, np.tile(these.depths, (blocks, 1, 1))).reshape(blocks, -1)


def handed_over(these: Switches, values: Array, along_the_track: bool) -> Array:
    """What the mean of a cell's ``values (4, rows, cells, nodes)`` changes by, as a switch moves by 1 σ of k,
    ``(switches, 4)``: trials go over from the stiffer node to the softer."""
    soft, stiff = (values[:, these.row, these.cell, these.below + node] for node in (0, 1))
    density = np.exp(-0.5 * these.at**2) / np.sqrt(2 * np.pi)
    apart = np.asarray(density * (soft - stiff)).T
    # Along a track these are no averages (see ``node_weights``).
    apart[:, [Observable.lift, Observable.peak_speed]] *= not along_the_track
    return apart


def _between(chains: Chains, points: Points, margin: str, depth: Array, walks: Bool, apart: Bool) -> Switches:
    deeper = depth[..., :-1] - depth[..., 1:] > DROP_M
    row, cell, below = np.nonzero((deeper | (walks[..., :-1] < walks[..., 1:])) & apart[..., None])
    if not len(row):
        return NONE
    grid = points.at.depths
    everywhere = np.empty((len(row), 2, len(grid)))
    everywhere[:] = grid
    margins = chains.margins(margin, points, (row, cell, below), everywhere)
    top, jumps = kernels.tops(margins, grid, depth[row, cell, below + 1])
    if not jumps.any():
        return NONE
    pairs = row[jumps], cell[jumps], below[jumps]
    depths = np.interp(top[jumps][..., None] + WINDOW, np.arange(len(grid)), grid)
    return Switches(*pairs, depths, _place(chains, points, margin, pairs, depths))


def _place(chains: Chains, points: Points, margin: str, pairs: Pairs, depths: Array) -> Array:
    part = kernels.suffices(chains.margins(margin, points, pairs, depths), depths)
    below = pairs[2]
    return np.asarray(NODES[below] + part * (NODES[below + 1] - NODES[below]))
