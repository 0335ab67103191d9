"""The c-leg as a circle that rolls on its lowest point: how depth, lift, step and leg angle are related."""

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import Robot


def deepest_m(robot: Robot) -> float:
    """2R - h: the depth at which the step has shrunk to nothing and the robot swims."""
    return 2 * robot.leg_radius_m - robot.axle_height_m


def critical_k_n_per_m(robot: Robot) -> float:
    """The stiffness that just carries the weight at the greatest depth, mg/(2R - h)."""
    return robot.mass_per_leg_kg * robot.gravity_m_s2 / deepest_m(robot)


def leg_radius_m(robot: Robot) -> float:
    """R, to which lengths in the ground are in proportion."""
    return robot.leg_radius_m


def froude_speed_m_s(robot: Robot) -> float:
    """√(gR): speeds of robots of all sizes over it are alike."""
    return float(np.sqrt(robot.gravity_m_s2 * robot.leg_radius_m))


def depth_at(robot: Robot, angle_rad: Floats) -> Floats:
    """Depth R(1 + cos θ) - h [m] of a leg's lowest point at angles θ of its centre, of any shape (0: straight below),
    belly on the surface.
    """
    return np.asarray(robot.leg_radius_m * (1 + np.cos(angle_rad)) - robot.axle_height_m)


def angle_at(robot: Robot, depth: Floats) -> Floats:
    """Angle [rad] of the leg's centre, 0 to π, at which it is that deep: the inverse of ``depth_at``."""
    above: Floats = (depth + robot.axle_height_m - robot.leg_radius_m) / robot.leg_radius_m
    return np.arccos(np.clip(above, -1.0, 1.0))


def chord(robot: Robot, depth: Floats) -> Floats:
    """Step length s = 2√(R² - (d + h - R)²) [m] at depths d [m] of any shape (Li09).

    2R where the leg holds above its centre, 0 at 2R - h.
    """
    above = np.maximum(depth + robot.axle_height_m - robot.leg_radius_m, 0.0)
    length: Floats = 2 * np.sqrt(np.maximum(robot.leg_radius_m**2 - above**2, 0.0))
    return length


def step_from_lift(lift_m: Floats, leg_radius_m: float) -> Floats:
    """Step length s = 2√(Δz(2R - Δz)) [m] of a body lifted by Δz [m]: the geometry lock, nothing fitted (Li09).

    It is ``chord`` with Δz = 2R - h - d. NaN where the lift is.
    """
    return np.asarray(2 * np.sqrt(np.maximum(lift_m * (2 * leg_radius_m - lift_m), 0.0)))


def stance_angle(step_m: Floats, leg_radius_m: float) -> Floats:
    """Largest leg angle while standing, α = asin(s/2R) [rad]: in a step the leg turns from -α to α."""
    angle: Floats = np.arcsin(np.clip(step_m / (2 * leg_radius_m), 0.0, 1.0))
    return angle
