"""Penetrometer readings: the force on a leg turned slowly down into virgin ground, the belly at rest on it.

They give what trials can't: the stiffness of undisturbed ground (a prior on k(φ)), and whether its force grows in
proportion to depth. A file has one reading per row, with columns

    phi, depth_m, force_n [, force_sd_n]        a force at a depth, or
    phi, k_n_per_m [, k_sd_n_per_m]             a stiffness: the force at d_r over d_r

where d_r is the robot's ``stiffness_depth_m`` (SandBot's: 3.9 cm). A file does not name the robot: depth and force of a
stiffness are known only once the trials' robot is.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats, Ints
from sandbot_common.delimited_text import number_in, read_csv
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_common.suggest import near

USUAL_SD = 0.02
"""Relative standard deviation of a reading that comes without one."""
SCALE_SD = 0.02
"""Relative standard deviation of the readings' common scale error: of the gauge, the leg and the zero of the depth."""
NEAR = 4e-3
"""A reading belongs to the nearest φ level of the trials if it is no farther away than this."""
_PARTS = (("cm", 100), ("mm", 1000))
LIMITS = {"phi": (0.4, 0.8), "depth_m": (1e-3, 0.2), "force_n": (0.0, 1e3), "k_n_per_m": (0.0, 1e5)}
"""Open intervals in which the readings of a leg in grains must lie."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Forces on one leg at depths ``(n,)``, or stiffnesses, whose depth is that of a robot."""

    phi: Floats
    depth_m: Floats
    force_n: Floats
    force_sd_n: Floats
    stiffness: tuple[Floats, Floats] | None = None
    """k and its standard deviation [N/m], where those were read; all but φ is then NaN."""
    unread: tuple[str, ...] = ()
    """Columns of the file that are ignored."""

    def of(self, robot: Robot) -> "Readings":
        """The readings as forces at depths: a stiffness k is F = k d_r at this robot's d_r."""
        if self.stiffness is None:
            return self
        k, sd = self.stiffness
        depth = np.full_like(k, robot.stiffness_depth_m)
        return Readings(self.phi, depth, k * depth, sd * depth, unread=self.unread)


@dataclass(frozen=True, eq=False)
class Pressed:
    """Readings assigned to the φ levels of cells."""

    level: Ints
    away: Floats
    """φ of the reading minus that of its level."""
    depth: Floats
    force: Floats
    sd: Floats
    """Standard deviation of each force, without the common scale error (``SCALE_SD``)."""
    notes: tuple[str, ...] = ()
    """Which readings and columns are not used, one sentence each."""

    def __len__(self) -> int:
        return len(self.level)

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of the forces [N²] ``(n, n)``: independent errors and one common scale error."""
        shared = SCALE_SD * self.force
        return np.asarray(np.diag(self.sd**2) + np.outer(shared, shared))

    @cached_property
    def whiten(self) -> Floats:
        """L⁻¹ with the covariance L Lᵀ, ``(n, n)``."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))


def read_readings(path: Path) -> Readings:
    """Read a file as described above. Raises InputError that names the row and the invalid value."""
    columns, numbered = read_csv(path)
    rows = list(numbered)
    kind = next((pair for pair in (("depth_m", "force_n"), ("k_n_per_m",)) if {"phi", *pair} <= set(columns)), None)
    if kind is None:
        _unread(path, columns, tuple(LIMITS))
        there = f"; there are: {', '.join(filter(None, columns))}" if any(columns) else ""
        raise InputError(f"{path}: row 1: columns phi, depth_m, force_n or phi, k_n_per_m are needed{there}")
    if not rows:
        raise InputError(f"{path}: no readings: nothing below the header")
    values = {name: _column(path, rows, name) for name in ("phi", *kind)}
    sd_name = kind[-1].replace("force_n", "force_sd_n").replace("k_n", "k_sd_n")
    unread = _unread(path, columns, ("phi", *kind, sd_name))
    read = values[kind[-1]]
    sd = _column(path, rows, sd_name, (0.0, np.inf)) if sd_name in columns else USUAL_SD * read
    if "depth_m" in values:
        return Readings(values["phi"], values["depth_m"], read, sd, unread=unread)
    unknown = np.full(len(rows), np.nan)
    return Readings(values["phi"], unknown, unknown, unknown, stiffness=(read, sd), unread=unread)


def _unread(path: Path, columns: list[str], known: tuple[str, ...]) -> tuple[str, ...]:
    """Columns that are not ``known``. Raises InputError for one that looks like a missing one misspelt."""
    unread = tuple(column for column in columns if column and column not in known)
    for column in unread:
        missing = [name for name in known if name not in columns]
        if meant := next((name for name in missing if name.startswith(column)), near(column, missing)):
            divide = next((f" Divide {unit} by {by}" for unit, by in _PARTS if column.endswith(f"_{unit}")), "")
            raise InputError(f"{path}: row 1: column {column!r} is not known, did you mean {meant!r}?{divide}")
    return unread


def at_levels(readings: Readings, level_phi: Floats, robot: Robot) -> Pressed:
    """The readings that belong to φ levels ``(levels,)`` of this robot's trials. Raises InputError if there is none."""
    readings = readings.of(robot)
    gap = np.abs(readings.phi[:, None] - level_phi)
    level, close = gap.argmin(axis=1), gap.min(axis=1) <= NEAR
    if not close.any():
        raise InputError(
            f"penetrometer readings at φ {readings.phi.min():.3f}-{readings.phi.max():.3f} are not at the trials' "
            f"levels: {', '.join(f'{phi:.3f}' for phi in level_phi)}"
        )
    away = readings.phi - level_phi[level]
    columns = (level, away, readings.depth_m, readings.force_n, readings.force_sd_n)
    return replace(Pressed(*(column[close] for column in columns)), notes=_notes(readings, close))


def _notes(readings: Readings, close: NDArray[np.bool_]) -> tuple[str, ...]:
    """What is not used: unknown columns, and readings that are not ``close`` to a level."""
    found, strays = [], readings.phi[~close]
    if readings.unread:
        found.append(f"penetrometer: columns that are not read: {', '.join(readings.unread)}")
    if len(strays):
        are = "is" if len(strays) == 1 else "are"
        at = ", ".join(f"{phi:.3f}" for phi in np.unique(strays.round(3)))
        found.append(f"penetrometer: {len(strays)} of {len(close)} readings {are} at no level of the trials: φ {at}")
    return tuple(found)


def _column(
    path: Path, rows: list[tuple[int, dict[str, str]]], name: str, limits: tuple[float, float] | None = None
) -> Floats:
    low, high = limits or LIMITS[name]
    found = np.empty(len(rows))
    for index, (number, row) in enumerate(rows):
        try:
            found[index] = number_in(row[name])
        except ValueError:
            raise InputError(f"{path}: row {number}, {name}: {row[name]!r} is not a number") from None
        if not low < found[index] < high:
            raise InputError(f"{path}: row {number}, {name}: {row[name]} is not between {low:g} and {high:g}")
    return found
