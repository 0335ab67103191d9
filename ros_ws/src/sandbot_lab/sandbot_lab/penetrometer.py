"""The penetrometer: with the belly at rest on a bed prepared to φ, one leg is turned slowly down until its lowest point
is at each depth, and the force on it is read.
"""

from collections.abc import Sequence

import numpy as np

from sandbot_common.errors import InputError
from sandbot_lab.ground import force
from sandbot_lab.physics import fresh_state, physics_record
from sandbot_lab.robot import checked_phi
from sandbot_lab.world import World

DEPTHS_M = (0.015, 0.025, 0.035, 0.044)
SENSOR_SD = 0.01
"""Relative standard deviation of the force sensor."""
COLUMNS = ("phi", "depth_m", "force_n", "force_sd_n")


def press(
    world: World, phis: Sequence[float], depths_m: Sequence[float] = DEPTHS_M, seed: int = 0, sd: float = SENSOR_SD
) -> list[dict[str, float]]:
    """One reading (``COLUMNS``) for each φ × depth; the bed misses each φ by the world's preparation error.

    Raises InputError for an impossible volume fraction, or a depth the leg can't reach with the belly at rest.
    """
    if world.resistive:
        raise InputError("resistive: this ground creeps under a leg that is pressed slowly; it has no penetrometer")
    radius, height = world.body.leg_radius_m, world.body.axle_height_m
    deepest = 2 * radius - height
    rows = []
    for level in phis:
        rng = np.random.default_rng([seed, round(checked_phi(level) * 1e6)])
        phi = checked_phi(level + world.noise.scale * world.noise.phi_sd * float(rng.standard_normal()))
        ground, state = physics_record(world, phi, int(rng.integers(2**62)))[0], fresh_state(world, 0.0)[0]
        for depth in depths_m:
            if not 0.0 < depth <= deepest:
                raise InputError(f"depth {depth} m: a leg reaches 0 to {deepest:.4f} m below the belly")
            theta = -float(np.arccos((depth + height) / radius - 1))
            force_n = float(force(ground, state, theta, 0.0, 0.0, height, 0.0, ground["k"]))
            reading = force_n * (1 + sd * float(rng.standard_normal()))
            rows.append(dict(zip(COLUMNS, (phi, float(depth), reading, sd * force_n), strict=True)))
    return rows
