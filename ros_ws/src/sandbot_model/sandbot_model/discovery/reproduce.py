"""Fits a selection from scratch: the explorer saves and ``compare`` prints the same numbers."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.compare import Comparison, compare
from sandbot_model.discovery.selection import Selection
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.physics.effect import Effect


def steps_of(selection: Selection, cells: Cells, effects: Mapping[str, Effect]) -> Comparison:
    """The ladder of ``compare``; where values are held by hand, one more step with them (see ``held_by_hand``).

    Raises InputError for an unknown effect or parameter.
    """
    steps = compare(cells, effects, selection.effects, base=selection.model)
    return Comparison((*steps, held_by_hand(steps[-1], selection.by_hand))) if selection.by_hand else steps


def held_by_hand(found: Fit, values: tuple[tuple[str, float], ...]) -> Fit:
    """The fit with some shared parameters held at ``values``, which have no standard error.

    Nothing is refitted: all others, and k(φ), are as fitted, with the standard errors of that fit. Raises InputError
    for a parameter that the model does not have, or a value that it can't have.
    """
    for name, value in values:
        found.model.parameter(name).check(value, name)
    held, names = dict(values), found.model.names
    theta = [held.get(name, fitted) for name, fitted in zip(names, found.point.theta.tolist(), strict=True)]
    step = fitted_at(replace(found.model, held=held), found.cells, replace(found.point, theta=np.array(theta)))
    stderr = found.stderr.copy()
    stderr[: len(names)][[name in held for name in names]] = np.nan
    return replace(step, stderr=stderr, covariance=np.zeros_like(step.covariance), at_minimum=False)
