"""The likelihood evaluated at several points of the search at once."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_model.physics.walking import Footing

STEP = 1e-5
"""Step of ln k in the derivatives."""


def parameter_steps(theta: Floats) -> Floats:
    """Steps of the parameters in the derivatives, relative but never 0; of the shape and in the units of ``theta``."""
    return STEP * np.maximum(np.abs(theta), 1e-3)


@dataclass(frozen=True, eq=False)
class States:
    """Predictions and likelihood at several points of the search at once; the first axis of every array is the point
    (row)."""

    theta: Floats
    """``(rows, parameters)``."""
    ln_k: Floats
    """Of each level's k [N/m], ``(rows, levels)``."""
    slope: Floats
    """dk/dφ at each level [N/m], ``(rows, levels)``."""
    footing: Footing
    """Arrays ``(rows, cells, nodes)``."""
    predicted: Floats
    """Cell means [SI], ``(rows, cells, 4)``."""
    covariance: Floats
    """Of the measured cell means about the predicted ones, ``(rows, cells, 4, 4)``."""
    whiten: Floats
    """Whitening matrix: makes residuals independent with variance 1, ``(rows, cells, 4, 4)``."""
    residual: Floats
    """Whitened, ``(rows, cells, 4)``."""
    cell_deviance: Floats
    """``(rows, cells)``."""
    pressed: Floats
    """Penetrometer readings minus model in standard deviations ``(rows, readings)``."""
    shared: Floats
    """Residuals of the priors: their means minus the nuisances, in units of their sd ``(rows, nuisances)``."""

    @cached_property
    def deviance(self) -> Floats:
        """-2 ln likelihood up to a constant ``(rows,)``: χ² plus the ln |V_c/V_c0| of mixtures near a switch."""
        prior = np.sum(self.pressed**2, axis=1) + np.sum(self.shared**2, axis=1)
        return np.asarray(self.cell_deviance.sum(axis=1) + prior)

    @cached_property
    def all_residuals(self) -> Floats:
        """All whitened residuals: cells, readings, priors, ``(rows, 4 cells + readings + nuisances)``."""
        return np.concatenate([self.residual.reshape(len(self.residual), -1), self.pressed, self.shared], axis=1)

    def take(self, rows: Ints) -> "States":
        """Some of the rows."""
        if len(rows) == len(self.theta) and (rows == np.arange(len(rows))).all():
            return self
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return States(footing=Footing(*(value[rows] for value in vars(self.footing).values())), **arrays)

    def lowest(self) -> "States":
        """The row of least deviance."""
        return self.take(np.argmin(self.deviance, keepdims=True))

    def where(self, better: Bools, other: "States") -> "States":
        """Rows of ``other`` where it is ``better (rows,)``, else of this."""
        if better.all():
            return other
        if not better.any():
            return self

        def pick(mine: Any, its: Any) -> Any:
            return np.where(better.reshape(-1, *(1,) * (mine.ndim - 1)), its, mine)

        arrays = {name: pick(getattr(self, name), getattr(other, name)) for name in _ARRAYS}
        feet = [pick(m, i) for m, i in zip(vars(self.footing).values(), vars(other.footing).values(), strict=True)]
        return States(footing=Footing(*feet), **arrays)


def joined(parts: Sequence[States]) -> States:
    """The rows of all parts, concatenated."""
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    feet = zip(*(vars(part.footing).values() for part in parts), strict=True)
    return States(footing=Footing(*(np.concatenate(each) for each in feet)), **arrays)


_ARRAYS = [field.name for field in fields(States) if field.name != "footing"]
