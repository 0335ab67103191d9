"""Where the project's own plans, calibrations and tables lie once installed, and reading those a plan names."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory

from sandbot_bringup.plan import Plan
from sandbot_common.files import load_yaml, read_yaml


def config_folder() -> Path:
    """The folder with the example plans, cameras.yaml, robot.yaml and nodes.yaml."""
    return Path(get_package_share_directory("sandbot_bringup")) / "config"


def files_of(plan: Plan, beside: Path, campaign: Path) -> dict[str, str]:
    """robot.yaml and cameras.yaml as text: the campaign's own once it has begun, else those the plan names (relative
    to ``beside``), else the project's.

    Raises InputError where a file is missing or not YAML.
    """
    files = {}
    for name, given in (("robot.yaml", plan.robot), ("cameras.yaml", plan.cameras)):
        path = beside / given if given else config_folder() / name
        # A campaign is one experiment: a calibration made later must not slip into its remaining trials.
        if (campaign / name).exists():
            path = campaign / name
        read_yaml(path)
        files[name] = path.read_text(encoding="utf-8")
    return files


def robot_and_cameras(files: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The mappings in the texts of ``files_of``."""
    return load_yaml(files["robot.yaml"]), load_yaml(files["cameras.yaml"])
