"""The next block of trials: those that are expected to say most about what is true for what they cost."""

from collections.abc import Sequence

import numpy as np

from sandbot_model.design.explanations import Explanation
from sandbot_model.design.information import information
from sandbot_model.physics.arrays import Array


def block(explanations: Sequence[Explanation], cost_s: Array, size: int) -> list[int]:
    """Indices of ``size`` places, one after the other that which adds most information a second to those before it.

    A place may come twice: a replicate competes with a new condition by the same measure, as the joint prediction of
    all trials of the block holds what they share. ``cost_s (n,)`` is what a trial costs at each place.
    """
    chosen: list[int] = []
    before = 0.0
    for _ in range(size):
        expected = expected_information(explanations, [[*chosen, place] for place in range(len(cost_s))])
        best = int(np.argmax((expected - before) / cost_s))
        chosen, before = [*chosen, best], float(expected[best])
    return chosen


def expected_information(explanations: Sequence[Explanation], blocks: Sequence[Sequence[int]]) -> Array:
    """Information [nat] about which explanation holds, all alike likely, from each block of trials ``(blocks,)``."""
    predicted = [one.of(np.array(blocks)) for one in explanations]
    means = np.stack([mean for mean, _ in predicted], axis=-2)
    covariances = np.stack([covariance for _, covariance in predicted], axis=-3)
    return information(np.full(len(explanations), 1.0 / len(explanations)), means, covariances)
