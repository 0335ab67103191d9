"""Short cuts for the lab's tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sandbot_clock.gait import PRESETS, leg_angles
from sandbot_common.robot import Robot
from sandbot_lab.direct import readings
from sandbot_lab.robot import simulate
from sandbot_lab.world import World, null_world, read_world

CONFIG = Path(__file__).resolve().parents[3] / "ros_ws/src/sandbot_bringup/config"


def with_noise(world, scale):
    """The same world with every noise multiplied by ``scale``."""
    return replace(world, noise=replace(world.noise, scale=scale))


QUIET = with_noise(null_world(), 0.0)
SGCS = read_world(CONFIG / "sgcs_world.yaml").walked_by(Robot(leg_mount_rad=0.5))
R, H, M, G = 0.0355, 0.025, 0.767, 9.81


def with_effect(name, **parameters):
    """The null world without noise, plus one effect."""
    return with_noise(World(effects={name: parameters}), 0.0)


def setpoints(omega, gait="UNIFORM", rate_hz=200.0):
    """Set-points of six periods."""
    t_s = np.arange(0.0, 6 * 2 * np.pi / omega, 1 / rate_hz)
    return t_s, *leg_angles(PRESETS[gait], omega, t_s)


def trial(world, phi, omega, gait="UNIFORM", seed=0, rate_hz=200.0):
    """A trace."""
    return simulate(world, phi, *setpoints(omega, gait, rate_hz), seed)


def read(world, phi, omega, **how):
    """Its readings."""
    return readings(trial(world, phi, omega, **how), world.body.leg_mount_rad)


def expected(k, omega, delta_t_s=0.4, beta=1.0):
    """physics.md section 2: (speed, lift, peak, first step) of a walker, None where it swims."""
    depth = M * (G + beta * R * omega / delta_t_s) / k
    if depth >= 2 * R - H:
        return None
    step = 2 * np.sqrt(R**2 - (depth + H - R) ** 2)
    return omega * step / np.pi, 2 * R - H - depth, beta * R * omega, step
