"""Stress on a leg element depends on its tilt and on the direction in which it moves."""

from functools import lru_cache

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import Robot
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Values
from sandbot_model.physics.geometry import deepest_m

A00, A10, B11, B01, B_11 = 0.206, 0.169, 0.212, 0.358, 0.055
"""Generic vertical coefficients, Li 2013 table S2 (only their ratios matter here)."""


class ResistiveForceTheory(Effect):
    """Shape of the resistive force over depth, tied to k at d_r: its scale ζ is absorbed in k."""

    identifier = "resistive_force_theory"
    stage = "balance"
    formula = "F -> F*f(z)/f(d_r): f is the integral of alpha_z(beta, gamma) z dA along the wetted leg, over z"
    source = "Li, Zhang & Goldman 2013, generic coefficients"
    seen_in = "d, T; loose ground"

    def apply(self, chain: Chain, p: Values) -> None:  # noqa: ARG002
        robot = chain.robot
        depths, shape = _shape(robot)
        chain.force = chain.force * np.interp(chain.penetration, depths, shape)


@lru_cache(maxsize=8)
def _shape(robot: Robot, elements: int = 361, depths: int = 60) -> tuple[Floats, Floats]:
    """Force over (depth × its value at d_r), at depths from just below the surface to 2R - h."""
    grid = np.linspace(1e-4, deepest_m(robot), depths)
    force = np.array([_force(robot, depth, elements) for depth in grid])
    per_depth = force / grid
    return grid, per_depth / np.interp(robot.stiffness_depth_m, grid, per_depth)


def _force(robot: Robot, depth: float, elements: int) -> float:
    """∫ α_z z dA along the arc (up to a constant) when the lowest point is at ``depth``, turning about the axle."""
    radius = robot.leg_radius_m
    axle = robot.axle_height_m
    # The body rests on the ground (axle at h) and the leg's lowest point is at the depth: where its centre then is.
    drop = depth + axle - radius
    ahead = np.sqrt(max(radius**2 - drop**2, 0.0))
    psi = np.linspace(-np.pi, np.pi, elements)
    x, z = ahead + radius * np.sin(psi), -depth + radius * (1 - np.cos(psi))
    velocity_x, velocity_z = (z - axle), -x
    tip = np.arccos(np.clip((depth + axle) / radius - 1, -1.0, 1.0)) + robot.arc_excess_rad
    wet = (z < 0) & (psi > -tip)
    # Tangent tilt of the element and direction of its motion, as in Li 2013 fig. 1.
    tilt = np.mod(psi + np.pi / 2, np.pi) - np.pi / 2
    direction = np.arctan2(-velocity_z, velocity_x)
    stress = _alpha_z(-tilt, direction)
    return float(np.sum(np.where(wet, stress * -z, 0.0)))


def _alpha_z(beta: Floats, gamma: Floats) -> Floats:
    """Vertical stress per depth, Fourier series of Li 2013 eq. S5."""
    return np.asarray(
        A00
        + A10 * np.cos(2 * beta)
        + B11 * np.sin(2 * beta + gamma)
        + B01 * np.sin(gamma)
        + B_11 * np.sin(-2 * beta + gamma)
    )
