"""Where the c-legs sit on their shafts: what robot.yaml says and /trial passes on."""

import math
from collections.abc import Mapping

from sandbot_common.errors import InputError


def leg_mount_rad(said: Mapping[str, object], where: str) -> float:
    """What must be added to shaft angles to give those of the c-legs' centres [rad]; 0 where nothing is said of it.

    Raises InputError, naming ``where``, if it is no angle.
    """
    value = said.get("leg_mount_rad", 0.0)
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{where}: leg_mount_rad: {value!r} is not an angle [rad]")
    return float(value)
