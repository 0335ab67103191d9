"""The names of formulas: every symbol that the catalogue shows may be typed.

A quantity of the chain has its own name (``depth``) and symbols (``d``). A few more are derived from those of the
chain. Four of these may be set as well, which sets the quantity that is still free at that stage (``v``: the share
kept).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import Robot
from sandbot_model.physics.chain import Chain

READABLE = {
    "clock": (
        *("k", "omega", "phi", "delta_t", "v_swim", "depth"),
        *("slow_phase_ratio", "swing_ratio", "slow_begin", "slow_end"),
    ),
    "step": ("leg_speed", "peak_ratio", "chord", "step", "a", "t_s", "t_left"),
    "speed": ("kept", "v"),
    "strength": ("penetration", "sigma_phi"),
    "balance": ("force", "extra_force", "F_z", "delta_v", "lift_ratio", "a_z", "mass", "added_mass", "gravity"),
}
"""Quantities that become available at each stage, in the order in which the chain is filled."""

SYMBOLS = {
    "omega": ("ω",),
    "phi": ("φ",),
    "delta_t": ("Δt", "Delta_t"),
    "depth": ("d",),
    "slow_phase_ratio": ("β", "beta"),
    "swing_ratio": ("β_swing", "beta_swing"),
    "slow_begin": ("d_slow",),
    "slow_end": ("d_end",),
    "peak_ratio": ("peak",),
    "chord": ("s_0",),
    "step": ("s",),
    "penetration": ("z",),
    "sigma_phi": ("σ", "sigma"),
    "force": ("F",),
    "delta_v": ("Δv", "Delta_v"),
    "added_mass": ("m_a",),
    "gravity": ("g",),
}
"""Symbols of the chain's quantities; ``g`` is the robot's until the balance, from then on gravity normal to the bed."""

CONSTANTS: dict[str, tuple[str, str, Callable[[Robot], float]]] = {
    "R": ("m", "leg radius", lambda robot: robot.leg_radius_m),
    "h": ("m", "height of the axle over the belly", lambda robot: robot.axle_height_m),
    "w": ("m", "width of a leg", lambda robot: robot.leg_width_m),
    "m": ("kg", "mass on one leg", lambda robot: robot.mass_per_leg_kg),
    "g": ("m/s²", "gravity", lambda robot: robot.gravity_m_s2),
    "d_r": ("m", "depth at which force laws are tied", lambda robot: robot.stiffness_depth_m),
    "D": ("m", "depth of the bed", lambda robot: robot.bed_depth_m),
    "Delta_xi": ("rad", "arc of the leg beyond a half circle", lambda robot: robot.arc_excess_rad),
    "N": ("1", "legs of a tripod", lambda robot: float(robot.legs_per_tripod)),
}
"""Constants of the robot: unit, meaning, value."""


@dataclass(frozen=True)
class Derived:
    """A quantity derived from others of the chain, and how it is set, if it can be."""

    unit: str
    doc: str
    get: Callable[[Chain], Floats]
    put: Callable[[Chain, Floats], None] | None = None


def _put_advance(chain: Chain, advance: Floats) -> None:
    chain.kept = _ratio(advance, chain.step, chain.kept)


def _put_speed(chain: Chain, speed: Floats) -> None:
    chain.kept = _ratio(np.pi * speed, chain.omega * chain.step, chain.kept)


def _put_all_force(chain: Chain, force: Floats) -> None:
    chain.extra_force = force - chain.force


def _put_acceleration(chain: Chain, acceleration: Floats) -> None:
    chain.lift_ratio = _ratio(acceleration * chain.delta_t, chain.delta_v, chain.lift_ratio)


def _ratio(above: Floats, below: Floats, otherwise: Floats) -> Floats:
    """``above / below``, or ``otherwise`` where ``below`` is 0."""
    above, below, otherwise = np.broadcast_arrays(above, below, otherwise)
    return np.asarray(np.divide(above, below, out=np.array(otherwise, dtype=float), where=below != 0.0))


DERIVED = {
    "a": Derived("m", "advance of the body in a step: s kept", lambda chain: chain.advance, _put_advance),
    "v": Derived("m/s", "mean speed when walking: ω s kept/π", lambda chain: chain.speed, _put_speed),
    "F_z": Derived(
        "N", "all ground force: F + extra_force", lambda chain: chain.force + chain.extra_force, _put_all_force
    ),
    "a_z": Derived(
        "m/s²",
        "vertical acceleration: Δv/Δt lift_ratio",
        lambda chain: chain.delta_v / chain.delta_t * chain.lift_ratio,
        _put_acceleration,
    ),
    "t_s": Derived("s", "how long a leg stands in a step, by the clock of the gait", lambda chain: chain.standing_time),
    "t_left": Derived("s", "time from the end of a stance to the next leg's stance", lambda chain: chain.time_left),
}


@dataclass(frozen=True)
class Symbol:
    """A name of formulas: all its spellings, unit, meaning, and the stage from which on it exists."""

    spellings: tuple[str, ...]
    unit: str
    doc: str
    stage: str


def readable(stage: str) -> dict[str, str]:
    """Every spelling that is known at a stage, and the quantity it means."""
    order = list(READABLE)
    names = [name for earlier in order[: order.index(stage) + 1] for name in READABLE[earlier]]
    return {spelling: name for name in names for spelling in (name, *SYMBOLS.get(name, ()))}


def stage_of(spelling: str) -> str:
    """The first stage at which a quantity exists; empty for an unknown one."""
    return next((stage for stage in READABLE if spelling in readable(stage)), "")


def settable(name: str) -> bool:
    """Whether a quantity may be set; some derived ones may not."""
    return name not in DERIVED or DERIVED[name].put is not None


def get(chain: Chain, name: str) -> Floats:
    """The value of a quantity, in its unit as ``listed`` and of the chain's shape."""
    derived = DERIVED.get(name)
    value: Floats = getattr(chain, name) if derived is None else derived.get(chain)
    return value


def put(chain: Chain, name: str, value: Floats) -> None:
    """Set a quantity: a value in its unit, which broadcasts to the chain's shape."""
    if (derived := DERIVED.get(name)) is not None:
        assert derived.put is not None, name
        derived.put(chain, value)
    else:
        setattr(chain, name, value)


def listed() -> tuple[Symbol, ...]:
    """All symbols, in the order of the chain, then the constants of the robot."""
    known: Mapping[str, Mapping[str, str]] = {field.name: field.metadata for field in fields(Chain)}
    found = []
    for stage, names in READABLE.items():
        for name in names:
            derived = DERIVED.get(name)
            unit, doc = (known[name]["unit"], known[name]["doc"]) if derived is None else (derived.unit, derived.doc)
            own = SYMBOLS.get(name, ())
            # A doc that begins with the symbol, "d, depth of ...", would repeat it.
            text = next((doc.removeprefix(f"{symbol}, ") for symbol in own if doc.startswith(f"{symbol}, ")), doc)
            found.append(Symbol((*own, name), unit, text, stage))
    robots = [Symbol((name,), unit, doc, "robot") for name, (unit, doc, _) in CONSTANTS.items()]
    first = Symbol(("first",), "1", "1 in the first step, on virgin ground; 0 in all others", "any")
    return (*found, *robots, first, Symbol(("K(phi)",), "N/m", "the fitted k at another volume fraction", "any"))
