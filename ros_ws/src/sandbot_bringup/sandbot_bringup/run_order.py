"""When each trial of a campaign is run: in random blocks, so that no drift of bed or room is an effect of φ or ω.

A block holds one replicate of every condition, in random order behind that of the sentinel condition, which so returns
through the campaign, and more often where the plan asks for it.
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
    """Blocks of one replicate of each condition, shuffled; that of condition ``head`` comes first."""
    blocks = []
    for number, block in enumerate(zip_longest(*replicates)):
        shuffled = np.random.default_rng([*seed, number]).permutation(len(block)).tolist()
        if head is not None:
            shuffled.sort(key=lambda condition: condition != head)
        blocks.append([one for condition in shuffled if (one := block[condition]) is not None])
    return blocks


def interspersed(blocks: Sequence[Sequence[T]], sentinels: Sequence[T], every: int) -> list[list[T]]:
    """The blocks with one of ``sentinels`` after each ``every`` trials, counted through all blocks."""
    left, count = list(sentinels), 0
    result: list[list[T]] = []
    for block in blocks:
        result.append([])
        for one in block:
            result[-1].append(one)
            count += 1
            if left and count % every == 0:
                result[-1].append(left.pop(0))
    return result
