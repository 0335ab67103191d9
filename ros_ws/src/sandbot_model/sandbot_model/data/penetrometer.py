"""Penetrometer readings: the force on a leg turned slowly down into virgin ground, the belly at rest on it.

They give what trials can't: the stiffness of undisturbed ground (a prior on k(φ)), and whether its force grows in
proportion to depth. A file has one reading a row, with columns

    phi, depth_m, force_n [, force_sd_n]        a force at a depth, or
    phi, k_n_per_m [, k_sd_n_per_m]             a stiffness: the force at d_r = 3.9 cm over d_r
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_common.files import read_csv

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

D_R = 0.039
"""Depth [m] at which a stiffness is the force over depth (physics §6)."""
USUAL_SD = 0.02
"""Relative standard deviation of a reading that comes without one."""
NEAR = 4e-3
"""A reading counts for the φ level of the trials that is no farther away than this."""
LIMITS = {"phi": (0.4, 0.8), "depth_m": (1e-3, 0.2), "force_n": (0.0, 1e3), "k_n_per_m": (0.0, 1e5)}
"""What a reading of a leg in grains can be; the lower ends are not in."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Forces on one leg ``(n,)`` each."""

    phi: Floats
    depth_m: Floats = field(metadata={"unit": "m"})
    force_n: Floats = field(metadata={"unit": "N"})
    force_sd_n: Floats = field(metadata={"unit": "N"})


@dataclass(frozen=True, eq=False)
class Pressed:
    """Readings that belong to the levels of some cells."""

    level: Ints
    away: Floats
    """φ of the reading minus that of its level."""
    depth: Floats
    force: Floats
    sd: Floats

    def __len__(self) -> int:
        return len(self.level)


def read_readings(path: Path) -> Readings:
    """Read a file as above. Raises InputError naming the row and the value that can't be."""
    columns, numbered = read_csv(path)
    rows = list(numbered)
    kind = next((pair for pair in (("depth_m", "force_n"), ("k_n_per_m",)) if {"phi", *pair} <= set(columns)), None)
    if kind is None or not rows:
        raise InputError(f"{path}: columns phi, depth_m, force_n or phi, k_n_per_m and a row a reading are needed")
    values = {name: _column(path, rows, name) for name in ("phi", *kind)}
    sd_name = kind[-1].replace("force_n", "force_sd_n").replace("k_n", "k_sd_n")
    relative = np.full(len(rows), USUAL_SD)
    if sd_name in columns:
        relative = _column(path, rows, sd_name, (0.0, np.inf)) / values[kind[-1]]
    depth = values.get("depth_m", np.full(len(rows), D_R))
    force = values["force_n"] if "force_n" in values else values["k_n_per_m"] * D_R
    return Readings(values["phi"], depth, force, relative * force)


def at_levels(readings: Readings, level_phi: Floats) -> Pressed:
    """The readings that belong to φ levels ``(levels,)``. Raises InputError if there is none."""
    gap = np.abs(readings.phi[:, None] - level_phi)
    level, near = gap.argmin(axis=1), gap.min(axis=1) <= NEAR
    if not near.any():
        raise InputError(
            f"penetrometer readings at φ {readings.phi.min():.3f}-{readings.phi.max():.3f} are not at the trials' "
            f"levels: {', '.join(f'{phi:.3f}' for phi in level_phi)}"
        )
    away = readings.phi - level_phi[level]
    columns = (level, away, readings.depth_m, readings.force_n, readings.force_sd_n)
    return Pressed(*(column[near] for column in columns))


def _column(
    path: Path, rows: list[tuple[int, dict[str, str]]], name: str, limits: tuple[float, float] | None = None
) -> Floats:
    low, high = limits or LIMITS[name]
    found = np.empty(len(rows))
    for index, (number, row) in enumerate(rows):
        try:
            found[index] = float(row[name])
        except ValueError:
            raise InputError(f"{path}: row {number}, {name}: {row[name]!r} is not a number") from None
        if not low < found[index] < high:
            raise InputError(f"{path}: row {number}, {name}: {row[name]} is not between {low:g} and {high:g}")
    return found
