"""What a report or the explorer shows, as plain data: the cells in bands, the fits with their curves, the provenance.

Everything is SI and not known is NaN or absent; figures and pages turn SI into cm and cm/s.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sandbot_model.data import regime
from sandbot_model.data.clustering import OMEGA_TOLERANCE, same_within
from sandbot_model.data.conditions import Cells, Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import NAMES, Observable

CLEARLY_SEM = 3.0
"""Standard errors of a cell's lift above which it is no noise."""


@dataclass(frozen=True)
class Band:
    """The cells of one volume fraction (and gait, where there are several): a panel, a row, a colour."""

    phi: float
    gait: str
    level: int
    cells: NDArray[np.int64] = field(metadata={"shape": "(n,)", "doc": "indices of its cells, ascending in ω"})
    label: str


BAND_SDS = 2.0
"""Half width of the band about a model's curve, in standard deviations of the prediction."""
BAND_EVERY = 3
"""The band is drawn at every third point of the curve."""


@dataclass(frozen=True, eq=False)
class SpeedBand:
    """Between which mean speeds the model's curves lie, ± ``BAND_SDS`` standard deviations."""

    omega_rad_s: Floats = field(metadata={"shape": "(m,)", "unit": "rad/s"})
    low_m_s: Floats = field(metadata={"shape": "(n_bands, m)", "unit": "m/s"})
    high_m_s: Floats = field(metadata={"shape": "(n_bands, m)", "unit": "m/s"})


@dataclass(frozen=True, eq=False)
class Step:
    """One rung of the ladder: a fit and its speed curves."""

    fit: Fit
    omega_rad_s: Floats = field(metadata={"shape": "(m,)", "unit": "rad/s"})
    speed_m_s: Floats = field(metadata={"shape": "(n_bands, m)", "unit": "m/s"})

    @property
    def label(self) -> str:
        """What a person calls the step."""
        if not self.fit.effects:
            return f"{self.fit.model.base} model"
        return "+ " + " + ".join(map(readable, self.fit.effects))

    @property
    def whole_label(self) -> str:
        """The same where no base model stands beside it."""
        return f"{self.fit.model.base} model {self.label}" if self.fit.effects else self.label

    @cached_property
    def band(self) -> SpeedBand:
        """How far the speed curves may lie off, from the uncertainty of the fitted parameters; made when asked for.

        Where it may walk or swim the speed is one of two, not their mean ± something: there the band ends where the
        curve does.
        """
        cells, omega = self.fit.cells, self.omega_rad_s[::BAND_EVERY]
        rows = bands(cells)
        phi = np.array([[band.phi] for band in rows])
        clock = cells.clock[[band.cells[0] for band in rows]][:, None]
        half = BAND_SDS * self.fit.uncertainty(phi, omega, clock)[..., Observable.speed]
        middle = self.speed_m_s[:, ::BAND_EVERY]
        usual = np.median(half, axis=1, keepdims=True)
        lowest, highest = (end(self.speed_m_s, axis=1, keepdims=True) for end in (np.min, np.max))
        low = np.maximum(middle - half, np.maximum(lowest - usual, 0.0))
        return SpeedBand(omega, low, np.minimum(middle + half, highest + usual))


@dataclass(frozen=True)
class Provenance:
    """Which trials the figures rest on and what they can't show."""

    used: int
    excluded: tuple[tuple[str, str], ...] = ()
    """(trial_id, reason)."""
    limits: tuple[str, ...] = ()
    """What these data can't show, and why: one sentence each."""
    odd: tuple[str, ...] = ()
    """What is odd about the trials (see ``quality``): one sentence each."""

    @property
    def cautions(self) -> tuple[tuple[str, str], ...]:
        """(what it is, sentence) of both, for the top of a page."""
        return (*(("Can’t be shown.", line) for line in self.limits), *(("Check the data.", line) for line in self.odd))


def bands(cells: Cells) -> tuple[Band, ...]:
    """The cells as bands, loosest packing first."""
    gaits = np.array(cells.gait)
    found = []
    for level, phi in enumerate(cells.level_phi):
        for gait in sorted(set(gaits[cells.level == level].tolist())):
            indices = np.flatnonzero((cells.level == level) & (gaits == gait))
            indices = indices[np.argsort(cells.omega[indices])]
            found.append(Band(float(phi), gait, level, indices, f"φ {band_name(cells, int(indices[0]))}"))
    return tuple(found)


def band_name(cells: Cells, cell: int) -> str:
    """The φ of the cell's level, by which figures call it, and its gait where there are several."""
    phi = f"{cells.level_phi[cells.level[cell]]:.3f}"
    return f"{phi} {cells.gait[cell]}" if len(set(cells.gait)) > 1 else phi


def frequencies(cells: Cells) -> tuple[Floats, NDArray[np.int64]]:
    """The distinct leg frequencies [rad/s], ascending, and each cell's index among them, (n,).

    Replicates miss the frequency a little, so each cell has its own mean; what is one condition is one column.
    """
    column = same_within(cells.omega, OMEGA_TOLERANCE)
    total = np.bincount(column, cells.omega)
    return total / np.bincount(column), column


def measured(cells: Cells, observable: str) -> Floats:
    """Cell means of one observable [SI], (n,); NaN where not measured."""
    return cells.mean[:, Observable[observable]]


def scatter(cells: Cells, observable: str) -> Floats:
    """Standard deviation of one trial per cell [SI], (n,): the cell's own replicates, else the pooled pure error."""
    column = Observable[observable]
    own = cells.sd[:, column]
    return np.where(np.isfinite(own), own, cells.noise[column])


def walks(cells: Cells) -> NDArray[np.bool_]:
    """Whether the robot walks in each cell, (n,): its lift is clearly above nothing, or is above it and the robot
    clearly faster than swimming; where lift was not measured, it is faster.
    """
    mean, sem = cells.mean, np.nan_to_num(cells.sem)
    least_lift = np.maximum(regime.WALKING_LIFT_M, CLEARLY_SEM * sem[:, Observable.lift])
    fast = (mean - CLEARLY_SEM * sem)[:, Observable.speed] > regime.WALKING_SPEED_M_S
    return regime.walks(mean, least_lift) | (regime.walks(mean) & fast)


def residual_z(fit: Fit, observable: str) -> Floats:
    """Standardised residuals of one observable, (n,): measured minus model over its standard error."""
    return fit.residual_z[:, Observable[observable]]


def observable_label(observable: str) -> str:
    """What a person calls an observable, or another measurement that is proposed."""
    return Observable[observable].label if observable in NAMES else readable(observable)


def readable(identifier: str) -> str:
    """An identifier as words: ``leg_slip`` → ``leg slip``."""
    return identifier.replace("_", " ")
