"""Where the project's own plans, calibrations and tables are installed, and reading the files a plan names."""

from collections.abc import Callable, Mapping
from pathlib import Path

from sandbot_bringup.plan import Plan
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.files import read_text
from sandbot_common.robot import Robot, read_robot, robot_from_text
from sandbot_common.suggest import did_you_mean
from sandbot_record.bags.reader import is_bag
from sandbot_tracking.calibration import Camera, read_cameras

NO_CHOICE = ("cameras.yaml", "nodes.yaml", "robot.yaml")
"""Files in the folder that are neither plan nor world."""


def config_folder() -> Path:
    """The folder with the example plans, cameras.yaml, robot.yaml and nodes.yaml."""
    return config_file(".")


def shipped(path: Path) -> Path:
    """``path``, or the project's own file of that name if there is none here. Raises InputError if there is neither."""
    own = config_folder() / path
    if path.exists() or path.parent != Path():
        return path
    if own.is_file():
        return own
    names = sorted(file.name for file in config_folder().glob("*.yaml") if file.name not in NO_CHOICE)
    raise InputError(f"{path}: no such file{did_you_mean(str(path), names)}")


def files_of(plan: Plan, beside: Path, campaign: Path) -> dict[str, str]:
    """robot.yaml and cameras.yaml as text: the campaign's own once a trial is finished or when it is resumed, else
    those the plan names (relative to ``beside``), else the project's.

    Raises InputError if a file is missing or invalid.
    """
    files = {}
    # A campaign is one experiment: a calibration made later must not slip into its remaining trials.
    bound = beside.resolve() == campaign.resolve() or any(map(is_bag, (campaign / "trials").glob("[!.]*")))
    readers: tuple[tuple[str, str, Callable[[Path], Robot | dict[str, Camera]]], ...] = (
        ("robot.yaml", plan.robot, read_robot),
        ("cameras.yaml", plan.cameras, read_cameras),
    )
    for name, given, reader in readers:
        path = beside / given if given else config_file(name)
        if bound and (campaign / name).exists():
            path = campaign / name
        described = reader(path)
        files[name] = read_text(path)
        if not isinstance(described, Robot):
            _check_cameras(described, path)
    return files


def _check_cameras(cameras: Mapping[str, Camera], path: Path) -> None:
    """Raises InputError unless both cameras are present and share a frame rate: the tracker works on frame pairs."""
    if set(cameras) != {"dorsal", "lateral"}:
        raise InputError(f"{path}: cameras {', '.join(cameras)}: dorsal and lateral are needed")
    rates = {name: camera.frame_rate_hz for name, camera in cameras.items()}
    if len(set(rates.values())) > 1:
        raise InputError(f"{path}: frame_rate_hz: {rates['dorsal']:g} and {rates['lateral']:g}: one for both is needed")


def robot_of(files: Mapping[str, str]) -> Robot:
    """The robot of a campaign's files."""
    return robot_from_text(files["robot.yaml"], "robot.yaml")
