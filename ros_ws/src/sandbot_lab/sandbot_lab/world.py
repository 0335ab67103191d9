"""A world: the truth behind a campaign. Ground strength, response time, effects, noise; read from a sealed YAML file.

world = read_world(Path("world.yaml"));  trace = simulate(world, phi, t_s, angles, rates, seed)
"""

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sandbot_common.errors import InputError
from sandbot_common.files import write_text
from sandbot_common.parameters import from_mapping, parameter
from sandbot_common.robot import SANDBOT, Robot, robot_from_mapping, to_mapping
from sandbot_common.suggest import did_you_mean
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.effects import DRAWN, EFFECTS, checked_effect
from sandbot_lab.film import Film
from sandbot_lab.resistive import ResistiveGround
from sandbot_lab.week import Occasion, Week

SCHEMA = "sandbot.world/1"
HOLDING = ("phi_knots", "k_knots_n_per_m", "delta_t_s", "swim_m_s")
"""Keys of a world that, with its effects, describe ground that takes hold."""
NOISE_OF_ANY = ("scale", "phi_sd")
"""Keys of noise that apply to any ground."""
START_X_M = 0.15
"""Where the robot's com starts; frame trackway."""


@dataclass(frozen=True)
class Noise:
    """Scatter between replicates (standard deviations), all multiplied by ``scale``."""

    scale: float = parameter(1.0, doc="multiplies every standard deviation below", low=0.0, high=10.0)
    speed_sd_m_s: float = parameter(0.005, unit="m/s", doc="constant speed offset of a trial", low=0.0, high=0.1)
    lift_sd_m: float = parameter(0.0003, unit="m", doc="offset of a trial's largest rise", low=0.0, high=0.01)
    peak_sd: float = parameter(
        0.01, doc="relative offset of a trial's peak speed, mean speed unchanged", low=0.0, high=0.1
    )
    first_step_sd_m: float = parameter(
        0.001, unit="m", doc="starting place, in the first step only", low=0.0, high=0.01
    )
    phi_sd: float = parameter(
        0.0005, doc="preparation error of the volume fraction (direct trials)", low=0.0, high=0.01
    )


@dataclass(frozen=True)
class World:
    """Everything the virtual lab knows and the analysis must not. Raises InputError for invalid values."""

    phi_knots: tuple[float, ...] = parameter((0.580, 0.600, 0.633), doc="volume fractions of the strength knots")
    k_knots_n_per_m: tuple[float, ...] = parameter(
        (170.0, 205.0, 220.0),
        unit="N/m",
        doc="stiffness k at the knots, linear between and beyond",
        low=1.0,
        high=2000.0,
    )
    delta_t_s: float = parameter(0.4, unit="s", doc="response time of the ground", low=0.01, high=5.0)
    swim_m_s: float = parameter(0.02, unit="m/s", doc="speed of a robot that swims", low=0.0, high=0.1)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    noise: Noise = field(default_factory=Noise)
    robot: Robot | None = None
    """The robot that really walks, whatever robot.yaml says; None: the campaign's (`walked_by`), else SandBot."""
    week: Week = field(default_factory=Week)
    resistive: ResistiveGround | None = None
    """A resistive ground instead of the one that takes hold, which k, Δt, v_swim, effects and most noise describe."""

    film: Film = field(default_factory=Film)
    """Degradation of the cameras' pictures."""

    def __post_init__(self) -> None:
        """Fill in the defaults of the effects and refuse invalid values."""
        filled = {name: checked_effect(name, dict(given or {}), "effects") for name, given in self.effects.items()}
        object.__setattr__(self, "effects", filled)
        if self.resistive and self.effects:
            raise InputError(f"effects: {', '.join(self.effects)}: they act on ground that holds; resistive: has none")
        rises = all(low < high for low, high in zip(self.phi_knots, self.phi_knots[1:], strict=False))
        if len(self.phi_knots) < 2 or len(self.phi_knots) != len(self.k_knots_n_per_m) or not rises:
            raise InputError(
                f"phi_knots, k_knots_n_per_m: {list(self.phi_knots)}, {list(self.k_knots_n_per_m)}:"
                " at least two knots each, as many of both, phi rising"
            )

    def stiffness_n_per_m(self, phi: float) -> float:
        """k(φ) of virgin ground, piecewise linear with linear extrapolation; never below 1 N/m."""
        knots, values = np.asarray(self.phi_knots), np.asarray(self.k_knots_n_per_m)
        piece = int(np.clip(np.searchsorted(knots, phi) - 1, 0, len(knots) - 2))
        slope = (values[piece + 1] - values[piece]) / (knots[piece + 1] - knots[piece])
        return float(max(values[piece] + slope * (phi - knots[piece]), 1.0))

    @property
    def body(self) -> Robot:
        """The robot that walks here."""
        return self.robot or SANDBOT

    def walked_by(self, robot: Robot) -> "World":
        """This world with the campaign's robot, unless it has its own."""
        return self if self.robot else dataclasses.replace(self, robot=robot)

    def at(self, occasion: Occasion) -> "World":
        """The world in one trial of the campaign, with the strength of virgin ground at that time."""
        factor = self.week.strength(occasion)
        ground = self.resistive and dataclasses.replace(
            self.resistive, strength_n_per_m3=factor * self.resistive.strength_n_per_m3
        )
        knots = tuple(factor * k for k in self.k_knots_n_per_m)
        return dataclasses.replace(self, k_knots_n_per_m=knots, resistive=ground)


def null_world() -> World:
    """The world without effects, which the base model describes (k with a knee at φ = 0.6, Δt = 0.4 s)."""
    return World()


def read_world(path: Path) -> World:
    """A world from its YAML file. Raises InputError with file, section and value."""
    return world_from_mapping(read_yaml(path), str(path))


def world_from_mapping(content: Mapping[str, Any], where: str) -> World:
    """A world from a mapping as in the YAML file; missing sections take their defaults."""
    content = _migrated(content, where)
    known = ("schema", *(item.name for item in dataclasses.fields(World)))
    for key in content:
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}{did_you_mean(str(key), known)}")
    values = dict(content)
    schema = values.pop("schema", SCHEMA)
    if schema != SCHEMA:
        raise InputError(f"{where}: schema: {schema!r} is not {SCHEMA!r}")
    if "resistive" in values:
        _check_resistive(values, where)
    sections: dict[str, Any] = {
        "noise": from_mapping(Noise, values.pop("noise", {}), f"{where}: noise"),
        "week": from_mapping(Week, values.pop("week", {}), f"{where}: week"),
        "film": from_mapping(Film, values.pop("film", {}), f"{where}: film"),
    }
    if "resistive" in values:
        # An empty value is a ground with all defaults.
        given = values.pop("resistive")
        sections["resistive"] = from_mapping(ResistiveGround, {} if given is None else given, f"{where}: resistive")
    if "robot" in values:
        sections["robot"] = robot_from_mapping(values.pop("robot"), f"{where}: robot")
    effects = values.pop("effects", None)
    effects = {} if effects is None else effects
    if not isinstance(effects, Mapping):
        raise InputError(f"{where}: effects: expected a mapping of effects, got {effects!r}")
    sections["effects"] = {name: checked_effect(name, given, f"{where}: effects") for name, given in effects.items()}
    try:
        return dataclasses.replace(from_mapping(World, values, where), **sections)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(where) else f"{where}: {text}") from None


def _check_resistive(values: Mapping[str, Any], where: str) -> None:
    """Raise InputError for keys that have no meaning on resistive ground."""
    ignored = [key for key in HOLDING if key in values]
    noise = values.get("noise")
    ignored += [f"noise: {key}" for key in (noise if isinstance(noise, Mapping) else ()) if key not in NOISE_OF_ANY]
    if ignored:
        raise InputError(f"{where}: {ignored[0]}: means nothing on the ground of resistive:; leave it out")


_OLD_NAMES = {"k_knots_n_m": "k_knots_n_per_m", "k_l_n_m": "k_l_n_per_m"}
_OLD_ROBOT = {"radius_m": "leg_radius_m", "mass_kg": "mass_per_leg_kg"}


def _migrated(content: Mapping[str, Any], where: str) -> dict[str, Any]:
    """A world file of an earlier version with renamed or moved keys updated, each reported on stderr."""
    values = {_renamed(str(key), _OLD_NAMES, where): value for key, value in content.items()}
    if isinstance(effects := values.get("effects"), Mapping):
        values["effects"] = {
            name: {_renamed(str(key), _OLD_NAMES, where): value for key, value in given.items()}
            if isinstance(given, Mapping)
            else given
            for name, given in effects.items()
        }
    if isinstance(robot := values.get("robot"), Mapping):
        robot = {_renamed(str(key), _OLD_ROBOT, where): value for key, value in robot.items()}
        if "swim_m_s" in robot:
            print(f"{where}: robot: swim_m_s is now a key of the world itself, next to robot:", file=sys.stderr)
            values["swim_m_s"] = robot.pop("swim_m_s")
        values["robot"] = robot
    return values


def _renamed(key: str, names: Mapping[str, str], where: str) -> str:
    if key in names:
        print(f"{where}: {key} is now called {names[key]}", file=sys.stderr)
    return names.get(key, key)


def write_world(world: World, path: Path) -> None:
    """Write the world as YAML, whole or not at all; `read_world` gives the same world back."""
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "phi_knots": list(world.phi_knots),
        "k_knots_n_per_m": list(world.k_knots_n_per_m),
        "delta_t_s": world.delta_t_s,
        "swim_m_s": world.swim_m_s,
        "effects": {name: dict(values) for name, values in world.effects.items()},
        "noise": dataclasses.asdict(world.noise),
        "week": {**dataclasses.asdict(world.week), "k_jumps_at": list(world.week.k_jumps_at)},
    }
    if world.resistive is not None:
        for name in (*HOLDING, "effects"):
            del content[name]
        content["noise"] = {name: content["noise"][name] for name in NOISE_OF_ANY}
        content["resistive"] = dataclasses.asdict(world.resistive)
    if world.film != Film():
        content["film"] = dataclasses.asdict(world.film)
    if world.robot is not None:
        content["robot"] = to_mapping(world.robot)
    write_text(path, yaml.safe_dump(content, sort_keys=False))


# Parameter ranges in which an effect is detectable above the noise of 7 φ × 7 ω × 3 trials; else the defaults are.
_STRENGTH = {
    "disturbed_ground": {"k_l_n_per_m": (167.0, 180.0), "s_c": (0.88, 1.0)},
    "stance_overlap": {"eta": (0.12, 0.25)},
    "swimming_thrust": {"a_m_s2": (0.40, 0.48)},
    "leg_slip": {"sigma": (0.12, 0.20)},
}

# A whole arc bears more than its lowest point: alpha = k/(wR) of 246 to 319 kN/m3, near Li09's, keeps both walking and
# swimming within the same range of frequencies.
_ARC_STIFFNESS = (105.0, 127.0, 136.0)


# Effects that are identifiable in `li09_world.yaml`, as measured in docs/li09.md. Most are not: one per cent less of a
# step ends all walking, and a change of the ground's strength alone is equivalent to another k(φ).
_IDENTIFIABLE = {"swimming_thrust": {"a_m_s2": (0.42, 0.48)}, "crater_refill": {"z0_m": (0.004, 0.006)}}


def draw_additional(world: World, seed: int) -> World:
    """The world with one more effect, drawn at random among those that are identifiable in `li09_world.yaml`.

    Raises InputError if it has all of them.
    """
    names = tuple(name for name in _IDENTIFIABLE if name not in world.effects)
    if not names:
        raise InputError(
            f"effects: {' and '.join(_IDENTIFIABLE)} are present already; no other can be hidden with them"
        )
    name, values = _drawn(seed, names, _IDENTIFIABLE)
    return dataclasses.replace(world, effects={**world.effects, name: values})


def draw_world(seed: int) -> World:
    """The null world plus one effect drawn from `DRAWN`, strong enough to be identified."""
    name, values = _drawn(seed, DRAWN, _STRENGTH)
    if name == "exact_leg_arc":
        return World(k_knots_n_per_m=_ARC_STIFFNESS, effects={name: values})
    return World(effects={name: values})


def _drawn(
    seed: int, names: Sequence[str], strength: Mapping[str, Mapping[str, tuple[float, float]]]
) -> tuple[str, dict[str, float]]:
    rng = np.random.default_rng([seed, 0x5EA1ED])
    name = names[int(rng.integers(len(names)))]
    values = EFFECTS[name].defaults()
    for key, (low, high) in strength.get(name, {}).items():
        # Three significant figures are easier to read when the file is unsealed.
        values[key] = float(f"{rng.uniform(low, high):.3g}")
    return name, values
