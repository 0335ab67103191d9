"""The lab's own camera model from cameras.yaml: trackway to pixels. (The tracker has its own code for the inverse.)"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.parameters import from_mapping, parameter

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Calibration:
    """One camera: pinhole, lens, pose in the trackway frame, and the plane its markers move in."""

    width: int = parameter(unit="px", doc="image width", low=16, high=20000)
    height: int = parameter(unit="px", doc="image height", low=16, high=20000)
    fx: float = parameter(unit="px", doc="focal length along image x", low=1.0)
    fy: float = parameter(unit="px", doc="focal length along image y", low=1.0)
    cx: float = parameter(unit="px", doc="principal point, x")
    cy: float = parameter(unit="px", doc="principal point, y")
    position_m: tuple[float, ...] = parameter(unit="m", doc="camera centre [x, y, z]")
    rotation: list[Any] = parameter(doc="3 rows of 3: the camera's axes in the trackway frame")
    plane: dict[str, Any] = parameter(doc="plane of the markers: {normal, offset_m}")
    frame_rate_hz: float = parameter(100.0, unit="Hz", doc="frames per second", low=0.1, high=10000.0)
    exposure_s: float = parameter(0.002, unit="s", doc="exposure time", low=0.0, high=10.0)
    distortion: tuple[float, ...] = parameter((0.0,) * 5, doc="k1, k2, p1, p2, k3")
    led_region: tuple[int, ...] | None = parameter(None, unit="px", doc="x, y, width, height of the sync LED", low=0)

    @property
    def plane_offset_m(self) -> float:
        """Offset of the markers' plane along its normal."""
        return float(self.plane["offset_m"])

    @cached_property
    def _pose(self) -> tuple[Floats, Floats]:
        return np.array(self.position_m, np.float64), np.array(self.rotation, np.float64)

    def pixels(self, xyz_m: ArrayLike) -> Floats:
        """Image points (..., 2) [px] of points (..., 3) [m; trackway frame], pixel centres at whole numbers."""
        centre, axes = self._pose
        seen = (np.asarray(xyz_m, np.float64) - centre) @ axes.T
        x, y = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
        if any(self.distortion):
            x, y = self._through_lens(x, y)
        return np.stack((self.fx * x + self.cx, self.fy * y + self.cy), axis=-1)

    def _through_lens(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Radial and tangential distortion (Brown–Conrady) of normalised image coordinates."""
        k1, k2, p1, p2, k3 = self.distortion
        square = x**2 + y**2
        radial = 1.0 + k1 * square + k2 * square**2 + k3 * square**3
        return (
            radial * x + 2.0 * p1 * x * y + p2 * (square + 2.0 * x**2),
            radial * y + 2.0 * p2 * x * y + p1 * (square + 2.0 * y**2),
        )


def calibration(mapping: Mapping[str, Any], where: str) -> Calibration:
    """One camera's calibration from its section of cameras.yaml. Raises InputError naming section and value."""
    read = from_mapping(Calibration, mapping, where)
    if len(read.distortion) == 4:  # OpenCV's own default
        read = replace(read, distortion=(*read.distortion, 0.0))
    rotation = _numbers(read.rotation)
    if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise InputError(f"{where}: rotation: {read.rotation} is not 3 orthonormal rows of 3 numbers")
    for name, length in (("position_m", 3), ("distortion", 5), ("led_region", 4)):
        value = getattr(read, name)
        if value is not None and len(value) != length:
            raise InputError(f"{where}: {name}: {list(value)} has {len(value)} numbers, expected {length}")
    offset = read.plane.get("offset_m")
    if (
        set(read.plane) != {"normal", "offset_m"}
        or read.plane["normal"] not in AXES
        or not np.isfinite(_numbers(offset)).all()
    ):
        raise InputError(f"{where}: plane: {read.plane} is not {{normal: x, y or z, offset_m: number}}")
    return read


def _numbers(value: object) -> Floats:
    try:
        return np.asarray(value, np.float64)
    except (TypeError, ValueError):
        return np.array([np.nan])
