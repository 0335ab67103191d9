"""Settings shared by all trials of an analysis: the robot, and the frame rate and accuracy of the cameras."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandbot_common.accuracy import SECTION, Accuracy, accuracy_from_mapping, worst
from sandbot_common.errors import InputError
from sandbot_common.parameters import given
from sandbot_common.robot import FILE, Robot, difference, read_robot, robot_from_mapping, robot_from_text
from sandbot_common.yaml_text import parse_yaml, read_yaml, shared_yaml
from sandbot_record.bags.reader import Bag
from sandbot_tracking.calibration import Camera, camera_sections

CAMERAS = "cameras.yaml"


@dataclass(frozen=True)
class Setting:
    """Settings found at ``where``; ``robot`` and ``accuracy`` are None, and ``frame_rate_hz`` NaN, if unknown."""

    where: str
    robot: Robot | None = None
    frame_rate_hz: float = math.nan
    accuracy: Accuracy | None = None

    @property
    def for_table(self) -> tuple[Robot | None, float, Accuracy | None]:
        """Arguments of ``from_rows`` after the rows."""
        return self.robot, self.frame_rate_hz, self.accuracy


def of_bag(bag: Bag, plan: Mapping[str, Any], frame_rate_hz: float) -> Setting:
    """A bag's setting, with the robot of /trial, else of the attached robot.yaml. Raises InputError."""
    if "robot" in plan:
        robot = robot_from_mapping(plan["robot"], f"{bag.path}: /trial: robot")
    elif FILE in bag.attachments:
        robot = robot_from_text(bag.attachments[FILE].decode(errors="replace"), f"{bag.path}: attachment {FILE}")
    else:
        robot = None
    accuracy = accuracy_of(attached_cameras(bag), _attached(bag))
    return Setting(str(bag.path), robot, frame_rate_hz, accuracy)


def attached_cameras(bag: Bag) -> Any:
    """The content of a bag's cameras.yaml, unchecked; None if it has none. Raises InputError if it is not YAML."""
    if CAMERAS not in bag.attachments:
        return None
    return parse_yaml(bag.attachments[CAMERAS].decode(errors="replace"), _attached(bag), shared_yaml)


def _attached(bag: Bag) -> str:
    return f"{bag.path}: attachment {CAMERAS}"


def of_campaign(folder: Path) -> Setting:
    """The setting in robot.yaml and cameras.yaml of a campaign folder. Raises InputError."""
    robot = read_robot(folder / FILE) if (folder / FILE).is_file() else None
    rate, accuracy = of_cameras(folder / CAMERAS) if (folder / CAMERAS).is_file() else (math.nan, None)
    return Setting(str(folder), robot, rate, accuracy)


def of_cameras(path: Path) -> tuple[float, Accuracy | None]:
    """Frame rate [Hz] of the slowest camera in a cameras.yaml, and its accuracy section. Raises InputError.

    Cameras need no pose here, as tables do not use it.
    """
    content = read_yaml(path)
    return _frame_rate(content, path), accuracy_of(content, str(path))


def accuracy_of(content: object, where: str) -> Accuracy | None:
    """The accuracy in a cameras.yaml's content; None if it has none. Raises InputError."""
    section = content.get(SECTION) if isinstance(content, Mapping) else None
    return None if section is None else accuracy_from_mapping(section, where)


def _frame_rate(content: Mapping[str, Any], cameras: Path) -> float:
    sections = camera_sections(content, str(cameras))
    if not any(isinstance(section, Mapping) for section in sections.values()):
        raise InputError(f"{cameras}: no camera in it")
    parsed = [given(Camera, section, f"{cameras}: {name}") for name, section in sections.items()]
    return float(min(camera.get("frame_rate_hz", Camera.frame_rate_hz) for camera in parsed))


def shared(settings: Iterable[Setting]) -> Setting:
    """The common setting of all: their robot, the slowest frame rate and the worst accuracy.

    Raises InputError if there are two robots, naming where each was found.
    """
    several = list(settings)
    rates = [setting.frame_rate_hz for setting in several if not math.isnan(setting.frame_rate_hz)]
    robots = [(setting.where, setting.robot) for setting in several if setting.robot is not None]
    where, robot = robots[0] if robots else ("", None)
    for there, other in robots:
        if robot is not None and other != robot:
            raise InputError(
                f"{where} and {there}: trials of two robots ({difference(robot, other)}); analyse one robot at a time"
            )
    accuracy = worst(setting.accuracy for setting in several if setting.accuracy is not None)
    return Setting(where, robot, min(rates, default=math.nan), accuracy)
