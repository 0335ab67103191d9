"""The material an atlas is drawn from, and the definition of a plate."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.fit import Fit
from sandbot_record.trials.table import Trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure

USUAL_OMEGA = 16.0
"""Leg frequency of the paper's pair of trials [rad/s]."""


def usual(omega_rad_s: Floats) -> float:
    """The leg frequency nearest the paper's of those given ``(n,)``."""
    return float(omega_rad_s[np.abs(omega_rad_s - USUAL_OMEGA).argmin()])


@dataclass(frozen=True, eq=False)
class Motion:
    """Time series of one trial; t = 0 is the start of the legs."""

    trial_id: str
    phi: float
    omega_rad_s: float
    clock_signal: tuple[float, float, float] | None
    """θ_s, θ_0 [rad] and d_c of its gait; None where the gait does not define them."""
    time_s: Floats  # (n,)
    speed_m_s: Floats
    """v_x(t), (n,); NaN where a marker was lost."""
    leg_time_s: Floats  # (m,)
    leg_angle_rad: Floats
    """Shaft angle of one leg, (m,)."""


@dataclass(frozen=True, eq=False)
class Published:
    """Mean speeds from another source, for comparison."""

    source: str
    phi: Floats
    omega_rad_s: Floats
    speed_m_s: Floats


@dataclass(frozen=True, eq=False)
class Material:
    """Trials, the models fitted to them, and optional extras."""

    trials: Trials
    """The usable ones."""
    cells: Cells
    fits: tuple[Fit, ...]
    """The ladder: the base model first, the chosen model last."""
    simple: Fit
    """The simple model, fitted as in the paper: up to the fastest ω of each φ."""
    full: Fit
    """The full model, likewise."""
    motions: tuple[Motion, ...] = ()
    """Closely and loosely packed, in that order; empty without bags."""
    published: Published | None = None

    @property
    def fit(self) -> Fit:
        """The chosen model. Raises InputError if the data do not determine its parameters."""
        return determined(self.fits[-1])

    @property
    def robot(self) -> Robot:
        """The robot that walked."""
        return self.cells.robot


def determined(fit: Fit) -> Fit:
    """The same fit. Raises InputError if the data do not determine its parameters."""
    if fit.undetermined:
        raise InputError(f"{fit.undetermined} of the {fit.name}")
    return fit


def nearest(values: Floats, levels: Floats) -> "np.ndarray[tuple[int], np.dtype[np.intp]]":
    """Index of the level nearest to each value, ``(n,)``."""
    found: np.ndarray[tuple[int], np.dtype[np.intp]] = np.abs(values[:, None] - levels).argmin(axis=1)
    return found


@dataclass(frozen=True)
class Plate:
    """One figure: its number in the paper, the stem of its files, its printed width, and the function that draws it."""

    number: str
    stem: str
    width_mm: float
    draw: "Callable[[Material, float], tuple[Figure, str]]"
    """(material, width [mm]) → (figure, caption)."""


ONE_COLUMN_MM, TWO_COLUMNS_MM = 85.0, 178.0
