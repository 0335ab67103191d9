"""Which cell of a data set is the condition that was chosen: a campaign that grows gives its cells other numbers."""

from math import hypot

import numpy as np

from sandbot_model.data.clustering import OMEGA_TOLERANCE, WIDEST_SCATTER
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.choice import Condition, cell_text

PHI_DIGITS, OMEGA_DIGITS = 4, 6
"""Decimals of φ, significant digits of ω in an address: finer than conditions are told apart."""


def condition_of(cells: Cells, index: int) -> Condition:
    """The condition of a cell, at the φ of its level."""
    phi = round(float(cells.level_phi[cells.level[index]]), PHI_DIGITS)
    return Condition(phi, float(f"{cells.omega[index]:.{OMEGA_DIGITS}g}"), cells.gait[index])


def index_of(cells: Cells, chosen: Condition | int | None) -> int | None:
    """The cell that was chosen; None if none was, or there is none: of the same gait, φ and ω within what is one.

    Addresses from before 2026-11 hold the number of the cell.
    """
    if chosen is None or isinstance(chosen, int):
        return chosen if chosen is not None and chosen < len(cells) else None
    off_phi = np.abs(cells.level_phi[cells.level] - chosen.phi) / WIDEST_SCATTER
    off_omega = np.abs(cells.omega - chosen.omega_rad_s) / (OMEGA_TOLERANCE * cells.omega)
    same = (off_phi <= 1) & (off_omega <= 1) & (np.array(cells.gait) == chosen.gait)
    near = np.flatnonzero(same)
    return min((int(i) for i in near), key=lambda i: hypot(off_phi[i], off_omega[i]), default=None)


def option_of(cells: Cells, chosen: Condition | int | None) -> str | None:
    """What the list of conditions calls the cell that was chosen."""
    index = index_of(cells, chosen)
    return None if index is None else cell_text(condition_of(cells, index))


def absent(cells: Cells, chosen: Condition | int | None) -> str:
    """A sentence where the condition chosen is none of these trials; empty where it is, or none was chosen."""
    if chosen is None or index_of(cells, chosen) is not None:
        return ""
    if isinstance(chosen, int):
        return f"These trials have {len(cells)} conditions: none has the number {chosen}, counted from 0."
    at = f"φ {chosen.phi:.3f}, ω {chosen.omega_rad_s:.4g} rad/s, gait {chosen.gait or 'not given'}"
    return f"No trial at {at}: the condition in the address is none of these trials'."
