"""Why a trial is run where it is, in words."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from sandbot_model.design.discrepancy import ELSE
from sandbot_model.design.explanations import Explanation
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.observables import Observable

LABELS = [one.label for one in Observable]


def because(explanations: Sequence[Explanation], place: int) -> str:
    """Which two differ most there, in standard deviations of what one trial leaves between them."""
    named = [one for one in explanations if one.name != ELSE]
    gaps = [(gap.max(), int(gap.argmax()), pair) for pair in combinations(named, 2) for gap in [_gap(*pair, place)]]
    size, observable, pair = max(gaps, key=lambda found: found[0], default=(0.0, 0, (named[0], named[0])))
    spread = np.sqrt(_own(explanations[-1], place) - _own(named[0], place)) if explanations[-1].name == ELSE else 0.0
    if np.max(spread) > size:
        label = LABELS[int(np.argmax(spread))]
        return f"something else than {named[0].name} would show there first, in the {label}"
    return f"{pair[0].name} and {pair[1].name} differ there by {size:.1f} sd in the {LABELS[observable]}"


def _gap(first: Explanation, second: Explanation, place: int) -> Array:
    """Of each observable ``(4,)``."""
    apart = np.abs(first.mean[place] - second.mean[place])
    return np.asarray(apart / np.sqrt(1.0 + _own(first, place) + _own(second, place)))


def _own(one: Explanation, place: int) -> Array:
    """Variance of each observable ``(4,)`` but for the noise of the trial."""
    return np.diagonal(one.common[place, :, place, :])
