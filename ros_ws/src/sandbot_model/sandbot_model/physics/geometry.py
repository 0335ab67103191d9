"""The c-leg above its lowest point: step length from depth, and depth from lift."""

import numpy as np

from sandbot_model.physics.arrays import Array
from sandbot_model.physics.robot import Robot


def chord(robot: Robot, depth: Array) -> Array:
    """Step length s = 2√(R² - (d + h - R)²) [m] (Li09); 2R where the leg holds above its centre, 0 at 2R - h."""
    above = np.maximum(depth + robot.axle_height_m - robot.leg_radius_m, 0.0)
    return np.asarray(2 * np.sqrt(np.maximum(robot.leg_radius_m**2 - above**2, 0.0)))
