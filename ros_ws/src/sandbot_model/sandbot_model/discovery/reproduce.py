"""Fits a selection from scratch: the explorer saves and ``compare`` prints the same numbers."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.choice import Selection
from sandbot_model.discovery.compare import Comparison, compare
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import Point
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.model import model_of


def steps_of(selection: Selection, cells: Cells, effects: Mapping[str, Effect]) -> Comparison:
    """The ladder of ``compare``; where values are held by hand, one more step with them and all else as last fitted.

    Raises InputError for an unknown effect or parameter.
    """
    steps = compare(cells, effects, selection.effects, base=selection.model)
    if not selection.by_hand:
        return steps
    held = dict(selection.by_hand)
    point = point_of(steps[-1], held)
    model = model_of(selection.model, selection.effects, effects, cells.robot, held)
    return Comparison((*steps, fitted_at(model, cells, point)))


def point_of(found: Fit, by_hand: Mapping[str, float] | None = None) -> Point:
    """The point of a fit, with some shared parameters set by hand. Raises InputError for one it does not have."""
    values = {name: estimate.value for name, estimate in found.parameters.items()}
    for name, value in (by_hand or {}).items():
        found.model.parameter(name)  # raises if there is no such parameter
        values[name] = value
    theta = np.array([values[name] for name in found.model.names])
    return replace(found.point, theta=theta)
