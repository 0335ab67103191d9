"""What all trials of one analysis share beside their rows: the robot that walked and how often it was filmed."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandbot_common.errors import InputError
from sandbot_common.files import read_yaml
from sandbot_common.robot import FILE, Robot, difference, read_robot, robot_from_mapping, robot_from_text
from sandbot_record.bags.reader import Bag

CAMERAS = "cameras.yaml"


@dataclass(frozen=True)
class Setting:
    """``robot`` is None and ``frame_rate_hz`` NaN where the data do not tell; ``where`` they were found."""

    where: str
    robot: Robot | None = None
    frame_rate_hz: float = math.nan


def of_bag(bag: Bag, plan: Mapping[str, Any], frame_rate_hz: float) -> Setting:
    """A bag's: the robot of /trial, else the attached robot.yaml; frames as often as they came. Raises InputError."""
    if "robot" in plan:
        robot = robot_from_mapping(plan["robot"], f"{bag.path}: /trial: robot")
    elif FILE in bag.attachments:
        robot = robot_from_text(bag.attachments[FILE].decode(errors="replace"), f"{bag.path}: attachment {FILE}")
    else:
        robot = None
    return Setting(str(bag.path), robot, frame_rate_hz)


def of_campaign(folder: Path) -> Setting:
    """What robot.yaml and cameras.yaml in a campaign's folder say. Raises InputError."""
    robot = read_robot(folder / FILE) if (folder / FILE).is_file() else None
    rate = frame_rate(folder / CAMERAS) if (folder / CAMERAS).is_file() else math.nan
    return Setting(str(folder), robot, rate)


def frame_rate(cameras: Path) -> float:
    """Frames a second of the slowest camera in a cameras.yaml. Raises InputError."""
    rates = [
        camera.get("frame_rate_hz", 100.0) for camera in read_yaml(cameras).values() if isinstance(camera, Mapping)
    ]
    for rate in rates:
        if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0.1 <= rate <= 1e4:
            raise InputError(f"{cameras}: frame_rate_hz: {rate!r} is outside [0.1, 10000] Hz (frames per second)")
    if not rates:
        raise InputError(f"{cameras}: no camera in it")
    return float(min(rates))


def shared(settings: Iterable[Setting]) -> Setting:
    """The setting that all agree in; the slowest frame rate. Raises InputError naming two places with two robots."""
    told = list(settings)
    rates = [setting.frame_rate_hz for setting in told if not math.isnan(setting.frame_rate_hz)]
    robots = [(setting.where, setting.robot) for setting in told if setting.robot is not None]
    where, robot = robots[0] if robots else ("", None)
    for there, other in robots:
        if robot is not None and other != robot:
            raise InputError(
                f"{where} and {there}: trials of two robots ({difference(robot, other)}); analyse one robot at a time"
            )
    return Setting(where, robot, min(rates, default=math.nan))
