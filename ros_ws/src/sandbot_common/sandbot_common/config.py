"""The project's own configuration files, found in the overlay, so that packages which need one don't import bringup."""

from pathlib import Path


def config_file(name: str) -> Path:
    """Where sandbot_bringup's config/``name`` is installed; "." is the folder itself."""
    from ament_index_python.packages import get_package_share_directory

    return Path(get_package_share_directory("sandbot_bringup")) / "config" / name
