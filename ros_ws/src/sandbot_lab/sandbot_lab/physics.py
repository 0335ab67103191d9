"""The kernel's flat records: everything a trial's physics needs, and the state it changes.

numba needs plain numbers. ``PHYSICS`` has, for each effect of the registry, a flag of the same name and a field
``<effect>_<parameter>`` for each of its parameters; ``STATE`` is the robot and the ground's memory of it.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common.robot import MAX_TRIPOD
from sandbot_lab.effects import EFFECTS
from sandbot_lab.jit import fingerprint
from sandbot_lab.world import World

SWEEPS = 512
"""Number of leg sweeps for which a local strength is drawn (it repeats after that)."""

FEET = 64
"""Footholds the ground remembers: more than a swimming robot leaves within its reach."""

_EFFECT_FIELDS = [
    field
    for name, effect in EFFECTS.items()
    for field in [(name, "?"), *((f"{name}_{parameter}", "f8") for parameter in effect.defaults())]
]

_ROBOT = {
    "radius": "leg_radius_m",
    "height": "axle_height_m",
    "width": "leg_width_m",
    "arc_excess": "arc_excess_rad",
    "mass": "mass_per_leg_kg",
    "gravity": "gravity_m_s2",
    "mount": "leg_mount_rad",
    "reference_depth": "stiffness_depth_m",
}
_NUMBERS = (*_ROBOT, "swim", "phi", "k", "delta_t")

PHYSICS = np.dtype(
    [
        *((name, "f8") for name in _NUMBERS),
        ("tripod", "i8"),  # legs of each
        ("k_sweep", "f8", (SWEEPS,)),  # stiffness met by each sweep, N/m
        ("k_disturbed", "f8"),
        ("s_c", "f8"),
        *_EFFECT_FIELDS,
        # the random offsets of this replicate
        *((name, "f8") for name in ("speed_offset", "lift_offset", "peak_offset", "first_step_offset")),
        (fingerprint(), "u1"),
    ]
)

STATE = np.dtype(
    [
        ("t", "f8"),
        ("started", "?"),
        ("set_angle", "f8", (2 * MAX_TRIPOD,)),  # last set-point
        ("set_rate", "f8", (2 * MAX_TRIPOD,)),
        # Where set-points last became faster, and where slower: angle, rate before and after; all 0 before they do.
        ("switch", "f8", (2 * MAX_TRIPOD, 2, 3)),
        ("angle", "f8", (2 * MAX_TRIPOD,)),  # actual leg angles
        ("rate", "f8", (2 * MAX_TRIPOD,)),
        ("turned", "f8"),  # mean rotation of all legs since the start
        ("x", "f8"),  # axle, from the mechanics alone, without replicate noise
        ("z", "f8"),
        ("v", "f8"),
        ("drift", "f8"),  # what replicate noise adds to x
        ("mode", "i8"),
        # the hold
        ("tripod", "i8"),
        ("grip_angle", "f8"),
        ("release_angle", "f8"),
        ("stop_angle", "f8"),
        ("grip_x", "f8"),
        ("centre_z", "f8"),
        ("gain", "f8"),
        # sweeps and what they left in the ground
        ("sweep", "i8", (2,)),
        ("sweep_k", "f8", (2,)),
        ("sweeps", "i8"),
        ("steps", "i8"),
        ("foot_x", "f8", (FEET,)),
        ("foot_t", "f8", (FEET,)),
        ("feet", "i8"),
        ("grip_t", "f8"),
        ("pace", "f8"),  # mean speed from the last foothold to this one
        ("bottom_t", "f8"),
        ("stroke_rate", "f8"),  # mean leg rate from one lowest point to the next
    ]
)


def physics_record(world: World, phi: float, seed: int) -> NDArray[Any]:
    """The ``PHYSICS`` record, shape (1,), of a trial at volume fraction ``phi``; all randomness comes from ``seed``."""
    rng = np.random.default_rng(seed)
    record = np.zeros(1, PHYSICS)
    for name, of_robot in _ROBOT.items():
        record[name] = getattr(world.body, of_robot)
    record["swim"], record["phi"], record["k"] = world.swim_m_s, phi, world.stiffness_n_per_m(phi)
    record["delta_t"], record["tripod"] = world.delta_t_s, world.body.legs_per_tripod
    for name, values in world.effects.items():
        record[name] = True
        for key, value in values.items():
            record[f"{name}_{key}"] = value
    _fill_from_robot(record, world)
    _draw_replicate(record, world, rng)
    _fill_strengths(record, world, phi, rng)
    return record


def _fill_from_robot(record: NDArray[Any], world: World) -> None:
    """Effect parameters that are 0 take the robot's value."""
    if not record["exact_leg_arc_tip_deg"]:
        record["exact_leg_arc_tip_deg"] = np.rad2deg(world.body.arc_excess_rad)
    if not record["finite_depth_bed_m"]:
        record["finite_depth_bed_m"] = world.body.bed_depth_m


def fresh_state(world: World, x_m: float) -> NDArray[Any]:
    """The ``STATE`` record, shape (1,), of a robot at rest on its belly at ``x_m`` on virgin ground."""
    state = np.zeros(1, STATE)
    state["x"], state["z"] = x_m, world.body.axle_height_m
    return state


def _draw_replicate(record: NDArray[Any], world: World, rng: np.random.Generator) -> None:
    noise, drawn = world.noise, rng.standard_normal(4)
    scales = (noise.speed_sd_m_s, noise.lift_sd_m, noise.peak_sd, noise.first_step_sd_m)
    names = ("speed_offset", "lift_offset", "peak_offset", "first_step_offset")
    for name, scale, value in zip(names, scales, drawn, strict=True):
        record[name] = noise.scale * scale * value


def _fill_strengths(record: NDArray[Any], world: World, phi: float, rng: np.random.Generator) -> None:
    record["k_sweep"] = world.stiffness_n_per_m(phi)
    if "phi_nonuniformity" in world.effects:
        local = phi + world.effects["phi_nonuniformity"]["sigma_phi"] * rng.standard_normal(SWEEPS)
        record["k_sweep"] = [world.stiffness_n_per_m(value) for value in local]
    record["k_disturbed"] = world.stiffness_n_per_m(phi)
    for name in ("disturbed_ground", "dilation"):
        if name in world.effects:
            record["s_c"] = world.effects[name]["s_c"]
    if "dilation" in world.effects:
        values = world.effects["dilation"]
        record["k_disturbed"] = world.stiffness_n_per_m(phi + values["xi"] * (values["phi_c"] - phi))
    if "disturbed_ground" in world.effects:
        record["k_disturbed"] = world.effects["disturbed_ground"]["k_l_n_per_m"]
