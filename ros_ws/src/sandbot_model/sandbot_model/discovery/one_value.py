"""What trials at a single ω or a single φ can't test, and the trials at others that can."""

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.clustering import OMEGA_TOLERANCE, frequencies
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.next_trials import NextTrial
from sandbot_model.discovery.untested import grid_of, new_conditions
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.walking import USUAL_K

OMEGA_RAD_S = (4.0, 28.0)
"""SandBot's usual range of ω."""
LEVELS = 7
"""Values tried in a range."""
UNTESTED = {"ω": "Δt", "φ": "what depends on φ"}
"""What a single value can't test: at one ω the k of each φ makes up for any Δt."""
WIDENED = ("adequate", "ambiguous")
"""Statuses of a verdict after which such trials are proposed."""
SEPARATES = {"ω": ("Δt", "k"), "φ": ("what depends on φ", "what does not")}


def single(cells: Cells) -> list[str]:
    """Those of ω and φ of which all trials have one value."""
    one_omega = np.ptp(cells.omega) <= OMEGA_TOLERANCE * cells.omega.max()
    return ["ω"] * bool(one_omega) + ["φ"] * (len(cells.level_phi) == 1)


def what_to_add(base: Fit) -> list[NextTrial]:
    """Trials at other values of a single ω or φ, in the usual range and where the robot is expected to walk; empty if
    there are several values of both."""
    cells = base.cells
    if not (alone := single(cells)):
        return []
    phi = _wider(USUAL_K.phi, cells.level_phi) if "φ" in alone else cells.level_phi
    omega = _wider(usual_omega(cells.robot), cells.omega) if "ω" in alone else frequencies(cells.omega)
    grid = grid_of(np.round(phi, 3), np.round(omega, 2))
    walks = base.predict(*grid.T).walking
    return new_conditions(cells, grid[walks], separates=SEPARATES[alone[0]])


def usual_omega(robot: Robot) -> tuple[float, float]:
    """The range of ω [rad/s] in which Rω²/g is that of SandBot in its usual range."""
    squared = SANDBOT.leg_radius_m / robot.leg_radius_m * robot.gravity_m_s2 / SANDBOT.gravity_m_s2
    low, high = (float(omega * np.sqrt(squared)) for omega in OMEGA_RAD_S)
    return low, high


def _wider(usual: tuple[float, float] | Floats, measured: Floats) -> Floats:
    """Values in a range that includes what was measured."""
    return np.linspace(min(usual[0], measured.min()), max(usual[-1], measured.max()), LEVELS)


def where(cells: Cells) -> str:
    """``at one ω``; empty if there are several values of ω and of φ."""
    return " and ".join(f"at one {axis}" for axis in single(cells))


def in_words(cells: Cells) -> str:
    """What trials at a single ω or φ can't test; empty if there are several values of both."""
    untested = " or ".join(UNTESTED[axis] for axis in single(cells))
    return f"trials {where(cells)} can't test {untested}: run others (next trials)" if untested else ""
