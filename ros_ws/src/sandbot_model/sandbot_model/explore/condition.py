"""Maps chosen conditions to cells of a data set: cell numbers change as a campaign grows, conditions do not."""

from math import hypot

import numpy as np

from sandbot_model.data.clustering import OMEGA_TOLERANCE, WIDEST_SCATTER
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.selection import Condition, cell_text

PHI_DIGITS, OMEGA_DIGITS = 4, 6
"""Decimals of φ and significant digits of ω in an address: finer than the tolerance of a condition."""


def condition_of(cells: Cells, index: int) -> Condition:
    """The condition of a cell, at the φ of its level."""
    phi = round(float(cells.level_phi[cells.level[index]]), PHI_DIGITS)
    return Condition(phi, float(f"{cells.omega[index]:.{OMEGA_DIGITS}g}"), cells.gait[index])


def index_of(cells: Cells, chosen: Condition | int | None) -> int | None:
    """The nearest cell of the same gait with φ and ω within tolerance; None if there is none, or none was chosen.

    Addresses from before 2026-11 hold the number of the cell.
    """
    if chosen is None or isinstance(chosen, int):
        return chosen if chosen is not None and chosen < len(cells) else None
    phi_distance = np.abs(cells.level_phi[cells.level] - chosen.phi) / WIDEST_SCATTER
    omega_distance = np.abs(cells.omega - chosen.omega_rad_s) / (OMEGA_TOLERANCE * cells.omega)
    same = (phi_distance <= 1) & (omega_distance <= 1) & (np.array(cells.gait) == chosen.gait)
    near = np.flatnonzero(same)
    return min((int(i) for i in near), key=lambda i: hypot(phi_distance[i], omega_distance[i]), default=None)


def option_of(cells: Cells, chosen: Condition | int | None) -> str | None:
    """The option in the list of conditions for the chosen cell."""
    index = index_of(cells, chosen)
    return None if index is None else cell_text(condition_of(cells, index))


def not_found(cells: Cells, chosen: Condition | int | None) -> str:
    """A message if no cell matches the chosen condition; empty if one does, or none was chosen."""
    if chosen is None or index_of(cells, chosen) is not None:
        return ""
    if isinstance(chosen, int):
        return f"These trials have {len(cells)} conditions: none has the number {chosen}, counted from 0."
    at = f"φ {chosen.phi:.3f}, ω {chosen.omega_rad_s:.4g} rad/s, gait {chosen.gait or 'not given'}"
    return f"No trial at {at}: the condition in the address is not among these trials."
