"""The ladder of a comparison: the base model, then one named effect more a step, all fitted to the same cells."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.fitting.fit import Fit, fit
from sandbot_model.fitting.plain import data_summary
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.geometry import step_from_lift
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

SCHEMA = "sandbot.comparison/1"


def compare(
    cells: Cells,
    effects: Mapping[str, Effect],
    names: Sequence[str] = (),
    *,
    base: str = "simple",
    progress: Callable[[str], None] = lambda _step: None,
) -> tuple[Fit, ...]:
    """Fits of the base model and of it with the first, the first two, … of the named effects.

    Raises InputError for a name that is not in the catalogue.
    """
    model_of(base, names, effects, cells.robot)
    steps: list[Fit] = []
    for count in range(len(names) + 1):
        model = model_of(base, names[:count], effects, cells.robot)
        steps.append(fit(model, cells, steps[-1].warm_start if steps else None))
        progress(" + ".join(names[:count]) or "base")
    return tuple(steps)


def geometry_lock(cells: Cells) -> Array:
    """Measured over locked step length of each cell ``(cells,)``; NaN where speed or lift is missing or it swims.

    Lift and speed both tell the step: s = 2√(Δz(2R - Δz)) and s = πv̄/ω. Their ratio is 1 for every effect on strength
    or balance; below 1 something between step and speed loses way, above 1 something gains it. Nothing is fitted.
    """
    radius = cells.robot.leg_radius_m
    lift = np.clip(cells.mean[:, Observable.lift], 0.0, radius)
    locked = step_from_lift(lift, radius)
    with np.errstate(invalid="ignore", divide="ignore"):
        walked = np.pi * cells.mean[:, Observable.speed] / cells.omega
        return np.where(locked > 0.3 * radius, walked / locked, np.nan)


def to_json(steps: Sequence[Fit]) -> dict[str, Any]:
    """Plain data of schema ``sandbot.comparison/1``."""
    cells = steps[0].cells
    floor = noise_floor(cells)
    return {
        "schema": SCHEMA,
        "model": steps[0].model.base,
        "data": data_summary(cells),
        "noise_floor_m_s": floor["speed"] if np.isfinite(floor["speed"]) else None,
        "noise_floor": {name: value if np.isfinite(value) else None for name, value in floor.items()},
        "steps": [step.to_dict() for step in steps],
    }
