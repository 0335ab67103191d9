"""Before a fit: whether a user's effect runs, and gives finite numbers, at the cells for all plausible parameters.

Without this check NaN would be taken for ground that never holds, and the robot for one that swims.
"""

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_common.errors import InputError
from sandbot_model.data.conditions import Cells
from sandbot_model.physics.effect import is_from_catalogue
from sandbot_model.physics.first_run import observed_quantities
from sandbot_model.physics.geometry import critical_k_n_per_m
from sandbot_model.physics.model import Model
from sandbot_model.physics.walking import KCurve, depth_grid

K_OVER_CRITICAL = 1.2
"""k at which effects are evaluated, over mg/(2R - h)."""
LARGEST = 1e100
"""Magnitude beyond which a quantity counts as infinite: a fit squares it, and sums that."""


def check_finite(model: Model, cells: Cells) -> None:
    """Evaluate users' effects with every parameter at its start and at both ends of its range. Raises InputError."""
    users = [effect.identifier for effect in model.walker.effects if not is_from_catalogue(effect)]
    if not users:
        return
    at = [i for i, name in enumerate(model.names) if name.partition(".")[0] in users]
    theta = np.repeat([[parameter.start for parameter in model.parameters]], 1 + 2 * len(at), axis=0)
    for row, i in enumerate(at):
        theta[1 + 2 * row : 3 + 2 * row, i] = model.parameters[i].low, model.parameters[i].high
    try:
        rows, columns = np.nonzero(_not_finite(model, cells, theta))
    except Exception as error:  # a user's effect may raise anything
        why = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise InputError(f"effect {' + '.join(users)}: fails at the conditions of these trials: {why}") from error
    if not len(rows):
        return
    row, cell = int(rows[0]), int(columns[0])
    name = model.names[at[(row - 1) // 2]] if row else ""
    who = name.partition(".")[0] or " + ".join(users)
    where = f"{name} is {theta[row, model.names.index(name)]:g}" if name else "its parameters start"
    phi, omega = cells.level_phi[cells.level[cell]], cells.omega[cell]
    raise InputError(
        f"effect {who}: gives no number at φ {phi:.4g} and ω {omega:.4g} rad/s where {where}; "
        "keep roots, logarithms and quotients in range, as in sqrt(maximum(..., 0))"
    )


def _not_finite(model: Model, cells: Cells, theta: Floats) -> Bools:
    """Cells ``(rows, cells)`` with an undefined or infinite quantity at a depth where legs may stand, for each θ."""
    k = np.full(len(cells.level_phi), K_OVER_CRITICAL * critical_k_n_per_m(model.robot))
    phi = cells.level_phi[cells.level]
    inputs = model.inputs(theta[:, None], k[0], cells.omega, phi, cells.clock, KCurve(cells.level_phi, k))
    # Legs stand neither at the surface, where d_r/d is infinite, nor at 2R - h, where the step is 0.
    depth, found = depth_grid(model.robot)[1:-1:3], np.zeros((len(theta), len(cells)), dtype=bool)
    with np.errstate(all="ignore"):
        for first_step in {False, model.walker.remembers}:
            for part in observed_quantities(model.walker.chain(*inputs, depth, first_step=first_step)):
                found |= ~(np.abs(part + 0.0 * depth) <= LARGEST).all(axis=-1)
    return found
