"""The robot's dimensions: declared once, read once (``robot.yaml``), the same for lab, tracking and analysis."""

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandbot_common.errors import InputError
from sandbot_common.files import parse_json
from sandbot_common.parameters import check, from_mapping, parameter, specs
from sandbot_common.topics import LEGS
from sandbot_common.yaml_text import parse_yaml, read_yaml

FILE = "robot.yaml"
"""Its name in a campaign's folder and among a bag's attachments."""
MAX_TRIPOD = 4
"""Most legs of a tripod."""


@dataclass(frozen=True)
class Robot:
    """A robot on c-legs in two tripods; SandBot (Li09) by default. Raises InputError for values out of range."""

    leg_radius_m: float = parameter(0.0355, unit="m", doc="c-leg radius R", low=0.005, high=0.5)
    axle_height_m: float = parameter(0.025, unit="m", doc="axle height h above the flat belly", low=0.0, high=1.0)
    leg_width_m: float = parameter(0.012, unit="m", doc="leg width w", low=0.001, high=0.5)
    arc_excess_rad: float = parameter(
        math.pi / 4, unit="rad", doc="c-leg arc beyond a half circle Δξ", low=0.0, high=2.5
    )
    mass_per_leg_kg: float = parameter(0.767, unit="kg", doc="mass a stance leg carries m", low=0.005, high=100.0)
    gravity_m_s2: float = parameter(9.81, unit="m/s²", doc="g", low=0.1, high=30.0)
    leg_mount_rad: float = parameter(
        0.0,
        unit="rad",
        doc="added to the shaft angle to give the angle of the c-leg's centre",
        low=-math.pi,
        high=math.pi,
    )
    axle_distance_m: float = parameter(
        0.20, unit="m", doc="distance between the markers of front and rear axle", low=0.01, high=2.0
    )
    stiffness_depth_m: float = parameter(
        0.039, unit="m", doc="depth d_r at which force laws are tied to the stiffness k", low=0.001, high=0.5
    )
    bed_depth_m: float = parameter(0.10, unit="m", doc="depth of the bed D", low=0.01, high=10.0)
    legs_per_tripod: int = parameter(3, doc="legs that step together and share the load N", low=1, high=MAX_TRIPOD)
    leg_order: tuple[str, ...] = parameter(
        LEGS, doc="joint names in the order of every array of legs: tripod A's, then tripod B's, half a period later"
    )

    def __post_init__(self) -> None:
        """Checks of each parameter, then of those that depend on each other."""
        for spec in specs(Robot):
            check(spec, getattr(self, spec.name), "robot")
        for name, high, what in (
            ("axle_height_m", 2 * self.leg_radius_m, "twice leg_radius_m: the legs would not reach below the belly"),
            ("leg_width_m", 2 * self.leg_radius_m, "twice leg_radius_m: a leg wider than its own circle"),
            ("stiffness_depth_m", self.bed_depth_m, "bed_depth_m: deeper than there is ground"),
        ):
            if getattr(self, name) >= high:
                raise InputError(f"{name}: {getattr(self, name):g} is not below {high:g}, {what}")
        if len(self.leg_order) != 2 * self.legs_per_tripod:
            raise InputError(
                f"leg_order: {len(self.leg_order)} names for two tripods of {self.legs_per_tripod} (legs_per_tripod); "
                f"{2 * self.legs_per_tripod} are needed"
            )
        if not all(self.leg_order) or len(set(self.leg_order)) != len(self.leg_order):
            raise InputError(f"leg_order: {', '.join(map(repr, self.leg_order))}: each leg needs a name of its own")


SANDBOT = Robot()
"""The robot of Li09."""


def read_robot(path: Path | str) -> Robot:
    """The robot described by a YAML file; missing keys are SandBot's. Raises InputError."""
    return robot_from_mapping(read_yaml(Path(path)), str(path))


def robot_from_text(text: str, where: str) -> Robot:
    """The robot of a YAML text, such as a bag's attachment."""
    return robot_from_mapping(parse_yaml(text, where), where)


def robot_of_trial(text: str) -> Robot | None:
    """The robot in the JSON of /trial; None if it has none. Raises InputError."""
    trial = parse_json(text, "/trial")
    given = trial.get("robot") if isinstance(trial, dict) else None
    return None if given is None else robot_from_mapping(given, "/trial: robot")


def robot_from_mapping(mapping: Any, where: str) -> Robot:
    """The robot of a mapping; ``where`` opens every error line. Raises InputError."""
    if isinstance(mapping, Mapping):
        for key in mapping:
            if remedy := _unit_remedy(str(key)):
                raise InputError(f"{where}: unknown key {key!r}; {remedy}")
    try:
        return from_mapping(Robot, mapping, where)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(where) else f"{where}: {error}") from None


def to_mapping(robot: Robot) -> dict[str, Any]:
    """The robot as plain data, from which ``robot_from_mapping`` restores it."""
    return dataclasses.asdict(robot) | {"leg_order": list(robot.leg_order)}


def difference(one: Robot, other: Robot, form: str = "{} {} and {}") -> str:
    """The parameters in which two robots differ, "leg_radius_m 0.05 and 0.0355, …"; empty if they are equal.

    ``form`` has places for the name, the value of one and that of the other.
    """
    pairs = ((spec.name, getattr(one, spec.name), getattr(other, spec.name)) for spec in specs(Robot))
    return ", ".join(form.format(name, _text(left), _text(right)) for name, left, right in pairs if left != right)


def _text(value: Any) -> str:
    return f"[{', '.join(value)}]" if isinstance(value, tuple) else f"{value:g}"


_CONVERSIONS = {
    "_mm": ("_m", "divided by 1000"),
    "_cm": ("_m", "divided by 100"),
    "_deg": ("_rad", "times π/180"),
    "_g": ("_kg", "divided by 1000"),
}


def _unit_remedy(key: str) -> str:
    """What a key with a wrong or missing unit should have been; empty for any other key."""
    bases = {re.sub("_(m_s2|kg|rad|m)$", "", spec.name): spec.name for spec in specs(Robot) if spec.unit}
    if key in bases:
        return f"say {bases[key]}: every key names its unit"
    for suffix, (unit, conversion) in _CONVERSIONS.items():
        right = key.removesuffix(suffix) + unit
        if key.endswith(suffix) and right in bases.values():
            return f"say {right} (values {conversion})"
    return ""
