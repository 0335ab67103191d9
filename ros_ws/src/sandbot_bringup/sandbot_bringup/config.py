"""Where the project's own plans, calibrations and tables lie once installed, and reading those a plan names."""

from collections.abc import Mapping
from pathlib import Path

from ament_index_python.packages import get_package_share_directory

from sandbot_bringup.plan import Plan
from sandbot_common.files import load_yaml, read_yaml
from sandbot_common.legs import leg_mount_rad


def config_folder() -> Path:
    """The folder with the example plans, cameras.yaml, robot.yaml and nodes.yaml."""
    return Path(get_package_share_directory("sandbot_bringup")) / "config"


def files_of(plan: Plan, beside: Path, campaign: Path) -> dict[str, str]:
    """robot.yaml and cameras.yaml as text: the campaign's own once it has begun, else those the plan names (relative
    to ``beside``), else the project's.

    Raises InputError where a file is missing or not YAML, or gives no angle as the legs' mount.
    """
    files = {}
    for name, given in (("robot.yaml", plan.robot), ("cameras.yaml", plan.cameras)):
        path = beside / given if given else config_folder() / name
        # A campaign is one experiment: a calibration made later must not slip into its remaining trials.
        if (campaign / name).exists():
            path = campaign / name
        read_yaml(path)
        files[name] = path.read_text(encoding="utf-8")
    leg_mount_of(files)
    return files


def leg_mount_of(files: Mapping[str, str]) -> float:
    """The robot's ``leg_mount_rad``. Raises InputError if it is no angle."""
    return leg_mount_rad(load_yaml(files["robot.yaml"]), "robot.yaml")
