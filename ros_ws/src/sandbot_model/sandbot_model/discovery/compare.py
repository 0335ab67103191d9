"""The ladder of a comparison: the base model, then one more named effect at each step, fitted to the same cells."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import to_mapping
from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit, fit
from sandbot_model.fitting.plain import data_summary, number
from sandbot_model.fitting.text import html_table, table
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.geometry import step_from_lift
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

SCHEMA = "sandbot.comparison/1"


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Sequence[Fit]):
    """The ladder: fits of the base model, then with one more effect at each step."""

    steps: tuple[Fit, ...]

    @property
    def fit(self) -> Fit:
        """The last step, with all effects."""
        return self.steps[-1]

    @property
    def cells(self) -> Cells:
        """What was fitted."""
        return self.fit.cells

    @cached_property
    def lock(self) -> Floats:
        """See ``geometry_lock``."""
        return geometry_lock(self.cells)

    def to_dict(self) -> dict[str, Any]:
        """Plain data of schema ``sandbot.comparison/1``; unknown numbers are None."""
        floor = noise_floor(self.cells)
        return {
            "schema": SCHEMA,
            "model": self.fit.model.base,
            "robot": to_mapping(self.cells.robot),
            "data": data_summary(self.cells),
            "noise_floor_m_s": number(floor["speed"]),
            "noise_floor": {name: number(value) for name, value in floor.items()},
            "steps": [step.to_dict() for step in self.steps],
        }

    @overload
    def __getitem__(self, index: int) -> Fit: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Fit, ...]: ...
    def __getitem__(self, index: int | slice) -> Fit | tuple[Fit, ...]:
        return self.steps[index]

    def __len__(self) -> int:
        return len(self.steps)

    def __repr__(self) -> str:
        return f"{table(ladder_rows(self.steps))}\n\n{self.fit}"

    def _repr_html_(self) -> str:
        return html_table(ladder_rows(self.steps)) + self.fit._repr_html_()


def compare(
    cells: Cells,
    effects: Mapping[str, Effect],
    names: Sequence[str] = (),
    *,
    base: str = "simple",
) -> Comparison:
    """Fits of the base model, and of it with the first, the first two, … of the named effects. Only the last step has
    sampled standard errors, as with ``discover``; the others have those of the curvature.

    Raises InputError for a name that is not in the catalogue.
    """
    model_of(base, names, effects, cells.robot)
    steps: list[Fit] = []
    for count in range(len(names) + 1):
        model = model_of(base, names[:count], effects, cells.robot)
        steps.append(fit(model, cells, steps[-1].warm_start if steps else None))
    return Comparison((*steps[:-1], with_sampled_errors(steps[-1])))


def geometry_lock(cells: Cells) -> Floats:
    """Step length by speed over step length by lift ``(cells,)``; NaN where either is missing or the robot swims.

    Both determine the step: s = πv̄/ω and s = 2√(Δz(2R - Δz)). Their ratio is 1 for every effect on strength or balance;
    below 1 something between step and speed loses way, above 1 something gains it. Nothing is fitted.
    """
    radius = cells.robot.leg_radius_m
    lift = np.clip(cells.mean[:, Observable.lift], 0.0, radius)
    locked = step_from_lift(lift, radius)
    with np.errstate(invalid="ignore", divide="ignore"):
        walked = np.pi * cells.mean[:, Observable.speed] / cells.omega
        return np.where(locked > 0.3 * radius, walked / locked, np.nan)
