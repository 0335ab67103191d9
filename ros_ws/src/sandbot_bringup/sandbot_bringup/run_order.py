"""The run order of a campaign: random blocks, so that no drift of bed or room is confounded with φ or ω.

A block holds one replicate of every condition in random order, preceded by that of the sentinel condition, which thus
recurs throughout the campaign, and more often if the plan asks for it.
"""

from collections.abc import Sequence
from itertools import zip_longest
from typing import TypeVar

import numpy as np

T = TypeVar("T")
ORDERS = ("randomised", "as_listed")


def sentinel_of(phi: Sequence[float], omega_rad_s: Sequence[float]) -> tuple[float, float]:
    """The condition in the middle of the grid."""
    return tuple(sorted(values)[len(values) // 2] for values in (phi, omega_rad_s))  # type: ignore[return-value]


def in_blocks(replicates: Sequence[Sequence[T]], head: int | None, seed: Sequence[int]) -> list[list[T]]:
    """Blocks of one replicate of each condition, shuffled, with condition number ``head`` first."""
    blocks = []
    for number, block in enumerate(zip_longest(*replicates)):
        shuffled = np.random.default_rng([*seed, number]).permutation(len(block)).tolist()
        if head is not None:
            shuffled.sort(key=lambda condition: condition != head)
        blocks.append([trial for condition in shuffled if (trial := block[condition]) is not None])
    return blocks


def interspersed(blocks: Sequence[Sequence[T]], sentinels: Sequence[T], every: int) -> list[list[T]]:
    """The blocks with one of ``sentinels`` after every ``every`` trials, counted across all blocks."""
    remaining, count = list(sentinels), 0
    result: list[list[T]] = []
    for block in blocks:
        result.append([])
        for trial in block:
            result[-1].append(trial)
            count += 1
            if remaining and count % every == 0:
                result[-1].append(remaining.pop(0))
    return result
