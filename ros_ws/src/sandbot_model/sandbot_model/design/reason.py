"""Why a trial is run in its condition, in words."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.design.discrepancy import ELSE
from sandbot_model.design.explanations import Explanation
from sandbot_model.physics.observables import Observable

LABELS = [observable.label for observable in Observable]


def because(explanations: Sequence[Explanation], place: int) -> str:
    """Which two explanations differ most there, in standard deviations of their difference in one trial."""
    named = [explanation for explanation in explanations if explanation.name != ELSE]
    gaps = [(gap.max(), int(gap.argmax()), pair) for pair in combinations(named, 2) for gap in [_gap(*pair, place)]]
    size, observable, pair = max(gaps, key=lambda found: found[0], default=(0.0, 0, (named[0], named[0])))
    discrepancy = explanations[-1]
    spread = np.sqrt(_variance(discrepancy, place) - _variance(named[0], place)) if discrepancy.name == ELSE else 0.0
    if np.max(spread) > size:
        label = LABELS[int(np.argmax(spread))]
        return f"something other than {named[0].name} would show there first, in the {label}"
    return f"{pair[0].name} and {pair[1].name} differ there by {size:.1f} sd in the {LABELS[observable]}"


def _gap(first: Explanation, second: Explanation, place: int) -> Floats:
    """Difference of two explanations in each observable ``(4,)``."""
    difference = np.abs(first.mean[place] - second.mean[place])
    return np.asarray(difference / np.sqrt(1.0 + _variance(first, place) + _variance(second, place)))


def _variance(explanation: Explanation, place: int) -> Floats:
    """Variance of each observable ``(4,)``, without the noise of the trial."""
    return np.diagonal(explanation.common[place, :, place, :])
