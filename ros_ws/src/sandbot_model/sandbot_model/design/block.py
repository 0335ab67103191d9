"""The next block of trials: those with the largest expected information about the true model per cost."""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.design.explanations import Explanation
from sandbot_model.design.information import information


def block(explanations: Sequence[Explanation], cost_s: Floats, size: int) -> list[int]:
    """Indices of ``size`` places, chosen greedily: each adds most information per second to those before it.

    A place may be chosen twice: replicates compete with new conditions by the same measure, since the joint prediction
    of a block includes what its trials share. ``cost_s (n,)`` is the cost of a trial at each place.
    """
    chosen: list[int] = []
    so_far = 0.0
    for _ in range(size):
        expected = expected_information(explanations, [[*chosen, place] for place in range(len(cost_s))])
        best = int(np.argmax((expected - so_far) / cost_s))
        chosen, so_far = [*chosen, best], float(expected[best])
    return chosen


def expected_information(explanations: Sequence[Explanation], blocks: Sequence[Sequence[int]]) -> Floats:
    """Information [nat] on which of equally probable explanations holds, from each block of trials ``(blocks,)``."""
    predicted = [explanation.of(np.array(blocks)) for explanation in explanations]
    means = np.stack([mean for mean, _ in predicted], axis=-2)
    covariances = np.stack([covariance for _, covariance in predicted], axis=-3)
    return information(np.full(len(explanations), 1.0 / len(explanations)), means, covariances)
