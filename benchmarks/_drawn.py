"""Campaigns drawn from the project's own chain, with noise: known truth for fits (the blind truth is the lab's)."""

from collections.abc import Mapping, Sequence

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.physics.averaging import predicted
from sandbot_model.physics.observables import COLUMNS
from sandbot_model.physics.walking import Inputs, KCurve, Walker
from sandbot_record.trials.table import Row, Trials, from_rows

GROUND = KCurve(np.array([0.58, 0.6, 0.633]), np.array([170.0, 205.0, 220.0]))
DELTA_T_S = 0.4
NOISE = np.array([0.005, 0.0004, 0.006, 0.001])
"""Scatter of a trial: speed, lift, peak speed, first step [SI]."""
PHI_SD = 6e-4


def drawn(
    walker: Walker,
    params: Sequence[Mapping[str, float]],
    phi: Sequence[float],
    omega_rad_s: Sequence[float],
    replicates: int,
    seed: int,
    noise: float = 1.0,
) -> Trials:
    """Every φ at every ω, ``replicates`` times, in a world in which the walker's effects act."""
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(phi, omega_rad_s, np.arange(replicates), indexing="ij")
    level, omega, replicate = (axis.ravel().astype(float) for axis in grid)
    true = level + rng.normal(0.0, PHI_SD, level.shape)
    inputs = Inputs(GROUND(true), omega, DELTA_T_S, true, k_of_phi=GROUND)
    seen = predicted(walker, inputs, params, GROUND).observables
    return table(true, omega, replicate, seen + noise * NOISE * rng.normal(size=seen.shape))


def table(phi: Floats, omega_rad_s: Floats, replicate: Floats, values: Floats) -> Trials:
    """Trials ``(n,)`` of observables ``(n, 4)``."""
    return from_rows(
        [
            Row(
                trial_id=f"t{i}",
                phi=float(phi[i]),
                omega_rad_s=float(omega_rad_s[i]),
                gait="UNIFORM",
                replicate=float(replicate[i]),
                **dict(zip(COLUMNS, map(float, values[i]), strict=True)),
            )
            for i in range(len(phi))
        ]
    )
