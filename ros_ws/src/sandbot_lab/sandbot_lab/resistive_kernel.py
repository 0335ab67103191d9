"""The time step on resistive ground: grains resist every element of a leg and soften where they are sheared.

The body moves by Newton's law. Nothing of the ground that takes hold (`ground`, `stance`, `kernel`) is used here: no
moment of hold, no response time, no stiffness. A leg's element of area dA at depth d, moving at v with its outer face
ahead, is resisted by

    dF = -α(φ) s(x) d dA [tanh(v_n/v_0) n + τ tanh(v_t/v_0) t]

with α the strength of virgin grains and s their softening factor, which falls from 1 to the residual fraction with the
distance that legs have sheared at x. The belly rests on the grains with friction.
"""

from math import ceil, cos, pi, sin, sqrt, tanh
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common.robot import MAX_TRIPOD
from sandbot_lab.jit import jit
from sandbot_lab.resistive import PHI, ResistiveGround
from sandbot_lab.world import World

STEP_S = 1e-4
ELEMENTS = 20
CELLS, CELL_M = 2000, 0.002
"""Cells that store the state of the ground, repeated periodically along the track."""
BELLY_N_PER_M = 8000.0
"""Stiffness of the bed under the belly, for the mass of one stance leg; damped at half the critical rate."""
REST, LIFTED, SLIDING = 0, 1, 2


PHYSICS = np.dtype(
    [
        *((name, "f8") for name in ("radius", "height", "width", "arc", "mass", "gravity", "mount")),
        *((name, "f8") for name in ("softened", "shear", "tangential", "yield_speed", "friction")),
        ("step", "f8"),  # longest, s
        ("tripod", "i8"),  # legs of each
        ("strength", "f8", (CELLS,)),  # of virgin ground
    ]
)
STATE = np.dtype(
    [
        ("t", "f8"),
        ("started", "?"),
        *((name, "f8") for name in ("x", "z", "v_x", "v_z")),
        ("angle", "f8", (2 * MAX_TRIPOD,)),
        ("torque", "f8", (2,)),  # on a leg of each tripod, about the axle
        ("sheared", "f8", (CELLS,)),  # fraction of the strength that is left
    ]
)


def records(world: World, ground: ResistiveGround, phi: float, seed: int, x_m: float) -> tuple[NDArray[Any], ...]:
    """The ``PHYSICS`` and ``STATE`` records, shape (1,), of a robot at rest; all randomness comes from ``seed``."""
    body, away = world.body, phi - PHI
    p, s = np.zeros(1, PHYSICS), np.zeros(1, STATE)
    p["radius"], p["height"], p["width"] = body.leg_radius_m, body.axle_height_m, body.leg_width_m
    p["arc"], p["mount"], p["tripod"] = pi + body.arc_excess_rad, body.leg_mount_rad, body.legs_per_tripod
    p["step"], p["mass"], p["gravity"] = STEP_S, body.mass_per_leg_kg, body.gravity_m_s2
    p["softened"] = min(max(ground.softened + ground.softened_per_phi * away, 0.0), 1.0)
    p["shear"], p["tangential"] = ground.shear_m, ground.tangential
    p["yield_speed"], p["friction"] = ground.yield_speed_m_s, ground.belly_friction
    places = np.arange(CELLS) // max(round(ground.patch_m / CELL_M), 1)
    patches = np.random.default_rng(seed).standard_normal(CELLS)[places]
    mean = max(ground.strength_n_per_m3 * (1 + ground.strength_per_phi * away), 0.0)
    p["strength"] = mean * np.exp(world.noise.scale * ground.patch_sd * patches)
    s["x"], s["z"], s["sheared"] = x_m, body.axle_height_m - body.mass_per_leg_kg * body.gravity_m_s2 / BELLY_N_PER_M, 1
    return p, s


@jit
def resist(p: Any, s: Any, tripod: int, theta: float, rate: float, dt: float) -> tuple[float, float]:
    """Force (x, z) on a tripod's leg at centre angle theta (0 = below); also shears the ground for a step dt."""
    total_x, total_z, s.torque[tripod] = 0.0, 0.0, 0.0
    length = p.radius * p.arc / ELEMENTS
    for element in range(ELEMENTS):
        # The arc starts at the axle, convex side ahead; n is the outward normal.
        along = (element + 0.5) / ELEMENTS * p.arc
        n_x = cos(along) * sin(theta) - sin(along) * cos(theta)
        n_z = cos(along) * cos(theta) + sin(along) * sin(theta)
        r_x, r_z = p.radius * (n_x - sin(theta)), p.radius * (n_z - cos(theta))
        depth = -(s.z + r_z)
        v_x, v_z = s.v_x + rate * r_z, s.v_z - rate * r_x
        across, lengthwise = v_x * n_x + v_z * n_z, v_z * n_x - v_x * n_z
        if depth <= 0.0 or across <= 0.0:
            continue
        cell = int((s.x + r_x) / CELL_M) % CELLS
        stress = p.strength[cell] * s.sheared[cell] * depth * p.width * length
        normal = -stress * tanh(across / p.yield_speed)
        shear = -p.tangential * stress * tanh(lengthwise / p.yield_speed)
        f_x, f_z = normal * n_x - shear * n_z, normal * n_z + shear * n_x
        total_x, total_z = total_x + f_x, total_z + f_z
        s.torque[tripod] += r_x * f_z - r_z * f_x
        # An element is about a cell long and shears the grains on both of its sides.
        share = 0.5 * length / CELL_M * sqrt(v_x * v_x + v_z * v_z) * dt / p.shear
        s.sheared[cell] -= (s.sheared[cell] - p.softened) * min(share, 1.0)
    return total_x, total_z


@jit
def step(p: Any, s: Any, theta: Any, rate: Any, dt: float) -> None:
    """Advance the body by dt (semi-implicit Euler); theta and rate (2,) are the tripods'."""
    f_x, f_z = 0.0, -p.mass * p.gravity
    sunk = p.height - s.z
    if sunk > 0.0:
        pressed = max(BELLY_N_PER_M * sunk - sqrt(BELLY_N_PER_M * p.mass) * s.v_z, 0.0)
        f_x, f_z = -p.friction * pressed * tanh(s.v_x / p.yield_speed), f_z + pressed
    for tripod in range(2):
        of_x, of_z = resist(p, s, tripod, theta[tripod], rate[tripod], dt)
        f_x, f_z = f_x + of_x, f_z + of_z
    s.v_x += f_x / p.mass * dt
    s.v_z += f_z / p.mass * dt
    s.x += s.v_x * dt
    s.z += s.v_z * dt


@jit
def run(physics: Any, state: Any, t: Any, angles: Any, rates: Any, out: Any) -> None:
    """As `kernel.run`: set-points t (n,), angles and rates (n, legs) in, the observable state (n, 5 + 3 legs) out."""
    p, s = physics[0], state[0]
    legs = 2 * p.tripod
    theta, rate = np.zeros(2), np.zeros(2)
    for i in range(t.size):
        span = t[i] - s.t if s.started else 0.0
        steps = ceil(span / p.step - 1e-6) if span > 0.0 else 0
        for done in range(steps):
            for tripod in range(2):
                before, after = 0.0, 0.0
                for leg in range(tripod * p.tripod, (tripod + 1) * p.tripod):
                    before, after = before + s.angle[leg] / p.tripod, after + angles[i, leg] / p.tripod
                rate[tripod] = (after - before) / span
                theta[tripod] = before + (after - before) * (done + 0.5) / steps + p.mount
            step(p, s, theta, rate, span / steps)
        s.t, s.started = t[i], True
        s.angle[:legs] = angles[i]
        out[i, 0], out[i, 1], out[i, 2], out[i, 4] = s.x, s.z, s.v_x, -1
        out[i, 3] = LIFTED if s.z > p.height else (SLIDING if abs(s.v_x) > 1e-3 else REST)
        for leg in range(legs):
            out[i, 5 + leg], out[i, 5 + legs + leg] = angles[i, leg], rates[i, leg]
            out[i, 5 + 2 * legs + leg] = s.torque[leg // p.tripod]
