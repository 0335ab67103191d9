"""The content of a report or the explorer as plain data: cells in bands, fits with their curves, provenance.

Everything is SI, and unknown values are NaN or absent; figures and pages convert to cm and cm/s.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats
from sandbot_model.data import regime
from sandbot_model.data.clustering import OMEGA_TOLERANCE, same_within
from sandbot_model.data.conditions import Cells, level_name
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import NAMES, Observable

SIGNIFICANT_SEM = 3.0
"""Standard errors by which a cell's lift exceeds zero, or its speed a swimmer's, to count as significant."""


@dataclass(frozen=True)
class Band:
    """The cells of one volume fraction (and gait, where there are several): a panel, a row, a colour."""

    phi: float
    gait: str
    level: int
    cells: NDArray[np.int64]
    """Indices of its cells, ascending in ω, (n,)."""
    label: str


SHOWN_SDS = 2.0
"""Half width of the range drawn about a model's curve, in standard deviations of the prediction."""
SHOWN_EVERY = 3
"""That range is computed at every third point of the curve."""


@dataclass(frozen=True, eq=False)
class SpeedUncertainty:
    """Range of the model's mean speed, ± ``SHOWN_SDS`` standard deviations."""

    omega_rad_s: Floats  # (m,)
    low_m_s: Floats  # (n_bands, m)
    high_m_s: Floats  # (n_bands, m)


@dataclass(frozen=True, eq=False)
class Step:
    """One rung of the ladder: a fit and its speed curves."""

    fit: Fit
    omega_rad_s: Floats  # (m,)
    speed_m_s: Floats  # (n_bands, m)

    @property
    def label(self) -> str:
        """Label of the step on the page."""
        if not self.fit.effects:
            return f"{self.fit.model.base} model"
        return "+ " + " + ".join(map(readable, self.fit.effects))

    @property
    def whole_label(self) -> str:
        """The label including the base model, for use on its own."""
        return f"{self.fit.model.base} model {self.label}" if self.fit.effects else self.label

    @cached_property
    def uncertainty(self) -> SpeedUncertainty:
        """Uncertainty of the speed curves from that of the fitted parameters, computed on first use.

        Near the end of walking the speed is that of either walking or swimming, and a mean ± s.d. would mislead: the
        range is limited to that of the curve, widened by its usual half width.
        """
        cells, omega = self.fit.cells, self.omega_rad_s[::SHOWN_EVERY]
        rows = bands(cells)
        phi = np.array([[band.phi] for band in rows])
        clock = cells.clock[[band.cells[0] for band in rows]][:, None]
        half = SHOWN_SDS * self.fit.uncertainty(phi, omega, clock)[..., Observable.speed]
        middle = self.speed_m_s[:, ::SHOWN_EVERY]
        usual = np.median(half, axis=1, keepdims=True)
        lowest, highest = (end(self.speed_m_s, axis=1, keepdims=True) for end in (np.nanmin, np.nanmax))
        low = np.maximum(middle - half, np.maximum(lowest - usual, 0.0))
        return SpeedUncertainty(omega, low, np.minimum(middle + half, highest + usual))


@dataclass(frozen=True)
class Provenance:
    """The trials that the figures are based on, and what these can't show."""

    used: int
    excluded: tuple[tuple[str, str], ...] = ()
    """(trial_id, reason)."""
    limits: tuple[str, ...] = ()
    """What these data can't show, and why: one sentence each."""
    odd: tuple[str, ...] = ()
    """What is odd about the trials (see ``quality``): one sentence each."""

    @property
    def cautions(self) -> tuple[tuple[str, str], ...]:
        """(kind, sentence) of each limit and oddity, for the top of a page."""
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
    """The φ of the cell's level, as in labels of figures, and its gait where there are several."""
    phi = level_name(cells, cell)
    return f"{phi} {cells.gait[cell]}" if len(set(cells.gait)) > 1 else phi


def frequencies(cells: Cells) -> tuple[Floats, NDArray[np.int64]]:
    """The distinct leg frequencies [rad/s], ascending, and each cell's index among them, (n,).

    Replicates scatter about the target frequency, so cells differ slightly; those within tolerance share a column.
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


def measured_name(cells: Cells) -> str:
    """Measured means and their bars in a legend."""
    return "measured ± error bars (r.m.s.)" if cells.error_bars else "measured, mean ± s.d. of a trial"


def walks(cells: Cells) -> NDArray[np.bool_]:
    """Whether the robot walks in each cell, (n,): its lift exceeds the walking threshold, and either that lift is
    significant or the speed is significantly above a swimmer's. Without lift, the speed decides.
    """
    mean, sem = cells.mean, np.nan_to_num(cells.sem)
    least_lift = np.maximum(regime.WALKING_LIFT_M, SIGNIFICANT_SEM * sem[:, Observable.lift])
    fast = (mean - SIGNIFICANT_SEM * sem)[:, Observable.speed] > regime.WALKING_SPEED_M_S
    return regime.walks(mean, least_lift) | (regime.walks(mean) & fast)


def is_ladder(steps: Sequence[Step]) -> bool:
    """Whether each step adds effects to the one before; otherwise they are rivals, or steps chosen by hand."""
    return all(set(before.fit.effects) <= set(step.fit.effects) for before, step in pairwise(steps))


def residual_z(fit: Fit, observable: str) -> Floats:
    """Standardised residuals of one observable, (n,): measured minus model over its standard error."""
    return fit.residual_z[:, Observable[observable]]


def observable_label(observable: str) -> str:
    """Label of an observable, or of another proposed measurement."""
    return Observable[observable].label if observable in NAMES else readable(observable)


def readable(identifier: str) -> str:
    """An identifier as words: ``leg_slip`` → ``leg slip``."""
    return identifier.replace("_", " ")
