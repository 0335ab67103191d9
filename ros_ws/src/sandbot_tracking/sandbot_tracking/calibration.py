"""Pixels to metres and back: a pinhole camera with lens distortion that looks at a plane of the trackway.

A camera sees rays, not points: to convert a pixel to metres, the plane in which its marker moves must be known: z =
offset for the dorsal camera, y = offset for the lateral one. The dorsal marker is on the body, so its plane rises with
the lift (``to_plane(..., offset_m)``); without this correction the parallax is about x·lift/Z.

Camera axes: x right, y down, z forward. ``rotation`` takes trackway axes to camera axes (its rows are the camera's
axes). Lens model: OpenCV's (k1, k2, p1, p2, k3).
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.accuracy import SECTION, accuracy_from_mapping
from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.parameters import from_mapping, parameter
from sandbot_common.suggest import did_you_mean
from sandbot_common.topics import VIEWS
from sandbot_common.yaml_text import read_yaml

NORMALS = {"x": 0, "y": 1, "z": 2}
LOW_HZ, HIGH_HZ = 0.1, 10000.0
"""Range of plausible frame rates."""
WIDEST_DEG = 150.0
"""Widest field of view of a pinhole with a lens; fisheyes have another model."""


@dataclass(frozen=True)
class Plane:
    """The plane a marker moves in: coordinate ``normal`` equals ``offset_m``."""

    normal: str = parameter(doc="axis normal to the plane", choices=tuple(NORMALS))
    offset_m: float = parameter(unit="m", doc="where the plane cuts that axis", low=-10.0, high=10.0)


@dataclass(frozen=True)
class Camera:
    """One calibrated camera (pixels; metres in the trackway frame)."""

    width: int = parameter(unit="px", doc="image width", low=1, high=20000)
    height: int = parameter(unit="px", doc="image height", low=1, high=20000)
    fx: float = parameter(unit="px", doc="focal length along image x", low=1.0)
    fy: float = parameter(unit="px", doc="focal length along image y", low=1.0)
    cx: float = parameter(unit="px", doc="principal point, x")
    cy: float = parameter(unit="px", doc="principal point, y")
    position_m: tuple[float, ...] = parameter(unit="m", doc="camera centre [x, y, z]", low=-10.0, high=10.0)
    rotation: tuple[tuple[float, ...], ...] = parameter(doc="3 rows, trackway axes to camera axes")
    plane: Plane = parameter(doc="plane of the markers: {normal, offset_m}")
    distortion: tuple[float, ...] = parameter((0.0,) * 5, doc="k1, k2, p1, p2, k3")
    frame_rate_hz: float = parameter(100.0, unit="Hz", doc="frames per second", low=LOW_HZ, high=HIGH_HZ)
    exposure_s: float = parameter(0.001, unit="s", doc="exposure time", low=0.0, high=1.0)
    led_region: tuple[int, ...] | None = parameter(None, unit="px", doc="x, y, width, height of the sync LED", low=0)
    rate_is_known: bool = True
    """False if ``frame_rate_hz`` was not given: a film's own rate then takes precedence over the default."""

    def __post_init__(self) -> None:
        rotation = np.asarray(self.rotation, dtype=float)
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
            raise InputError(f"camera rotation {rotation.tolist()} is not a rotation (orthonormal, right-handed)")

    @cached_property
    def matrix(self) -> Floats:
        """The camera matrix K, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @cached_property
    def _axes(self) -> Floats:
        return np.array(self.rotation, dtype=float)

    @cached_property
    def _centre(self) -> Floats:
        return np.array(self.position_m, dtype=float)

    @cached_property
    def _lens(self) -> Floats:
        return np.array(self.distortion, dtype=float)

    def to_pixels(self, xyz_m: ArrayLike) -> Floats:
        """Image points (n, 2) [px] of points (n, 3) [m]; NaN behind the camera."""
        seen = (np.atleast_2d(np.asarray(xyz_m, dtype=float)) - self._centre) @ self._axes.T
        ahead = np.where(seen[:, 2:] > 0, seen, np.nan)
        ray = ahead[:, :2] / ahead[:, 2:]
        return self._distort(ray) * (self.fx, self.fy) + (self.cx, self.cy)

    def _distort(self, ray: Floats) -> Floats:
        """Brown–Conrady as in OpenCV's calib3d: radial k1, k2, k3 and tangential p1, p2. (n, 2) to (n, 2)."""
        k1, k2, p1, p2, k3 = self._lens
        x, y = ray.T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.column_stack(
            (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
        )

    def _rays(self, px: Floats) -> Floats:
        """Directions (n, 3) in trackway axes of pixels (n, 2)."""
        if self._lens.any():
            import cv2

            # The default 5 iterations leave 1e-3 px at strong distortion.
            criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 1e-12)
            points = np.ascontiguousarray(px, dtype=float)[:, None, :]
            normal = cv2.undistortPoints(points, self.matrix, self._lens, criteria=criteria)[:, 0, :]
        else:
            normal = (px - (self.cx, self.cy)) / (self.fx, self.fy)
        return np.asarray(np.column_stack((normal, np.ones(len(normal)))) @ self._axes, dtype=float)

    def to_plane(self, px: ArrayLike, offset_m: ArrayLike | None = None) -> Floats:
        """Points (n, 3) [m] where the rays of pixels (n, 2) meet the plane; NaN stays NaN.

        ``offset_m``: the plane's place along its normal, one value or (n,); default: the camera's own plane.
        """
        points = np.atleast_2d(np.asarray(px, dtype=float))
        if points.shape[1] != 2:
            raise InputError(f"pixels of shape {points.shape}: (n, 2) is needed")
        axis = NORMALS[self.plane.normal]
        offset = np.asarray(self.plane.offset_m if offset_m is None else offset_m, dtype=float)
        rays = self._rays(points)
        distance = (offset - self._centre[axis]) / rays[:, axis]
        return np.asarray(self._centre + rays * distance[:, None], dtype=float)

    def covariance_m2(self, px: ArrayLike, covariance_px2: ArrayLike, offset_m: ArrayLike | None = None) -> Floats:
        """Covariances (n, 3, 3) [m²] of ``to_plane`` from pixel covariances: (n, 2) variances or (n, 2, 2).

        First order: J C Jᵀ, with J the derivative of ``to_plane`` by central differences of half a pixel.
        """
        points = np.atleast_2d(np.asarray(px, dtype=float))
        given = np.asarray(covariance_px2, dtype=float)
        square = given if given.ndim == 3 else given[:, :, None] * np.eye(2)
        steps = 0.5 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        offset = offset_m if offset_m is None or np.ndim(offset_m) == 0 else np.tile(np.asarray(offset_m), 4)
        moved = self.to_plane((points + steps[:, None]).reshape(-1, 2), offset).reshape(4, -1, 3)
        jacobian = np.stack((moved[0] - moved[2], moved[1] - moved[3]), axis=2)
        return np.asarray(jacobian @ square @ jacobian.transpose(0, 2, 1), dtype=float)

    def parallax(self, px: ArrayLike) -> Floats:
        """d(position)/d(plane offset), (n, 3): how far a point moves when its plane is moved by one metre."""
        rays = self._rays(np.atleast_2d(np.asarray(px, dtype=float)))
        return np.asarray(rays / rays[:, [NORMALS[self.plane.normal]]], dtype=float)


def camera_from_mapping(mapping: Any, where: str) -> Camera:
    """A camera from its YAML mapping. Raises InputError on anything missing, unknown or out of range."""
    if not isinstance(mapping, Mapping):
        raise InputError(f"{where}: expected a mapping of parameters, got {mapping!r}")
    camera = dict(mapping)
    rows = camera.get("rotation")
    if "rotation" in camera:
        camera["rotation"] = _matrix(rows, where)
    for key, lengths in (("position_m", (3,)), ("distortion", (4, 5)), ("led_region", (4,))):
        value = camera.get(key)
        if isinstance(value, list | tuple) and len(value) not in lengths:
            raise InputError(f"{where}: {key}: {value} has {len(value)} numbers, expected {lengths[-1]}")
    if isinstance(camera.get("distortion"), list) and len(camera["distortion"]) == 4:
        camera["distortion"] = [*camera["distortion"], 0.0]
    read = replace(from_mapping(Camera, camera, where), rate_is_known="frame_rate_hz" in camera)
    if read.rate_is_known:
        _check_exposure(read, where)
    _check_picture(read, where)
    return read


def _check_exposure(camera: Camera, where: str) -> None:
    period_s = 1.0 / camera.frame_rate_hz
    if camera.exposure_s > period_s:
        raise InputError(
            f"{where}: exposure_s: {camera.exposure_s:g} s is longer than a frame, {period_s:.3g} s "
            f"at frame_rate_hz: {camera.frame_rate_hz:g}"
        )


def _check_picture(camera: Camera, where: str) -> None:
    """Refuse what a picture of this size can't have."""
    for name, length_px, focal_px in (("fx", camera.width, camera.fx), ("fy", camera.height, camera.fy)):
        seen_deg = 2.0 * np.degrees(np.arctan2(length_px, 2.0 * focal_px))
        if seen_deg > WIDEST_DEG:
            raise InputError(
                f"{where}: {name}: {focal_px:g} px for {length_px} px is a field of view of {seen_deg:.0f} degrees, "
                f"at most {WIDEST_DEG:g}"
            )
    if camera.led_region is None:
        return
    left, top, width, height = camera.led_region
    if left + width > camera.width or top + height > camera.height:
        raise InputError(
            f"{where}: led_region: {list(camera.led_region)} (x, y, width, height) is not inside the picture, "
            f"{camera.width} x {camera.height} px"
        )


def _matrix(rows: Any, where: str) -> tuple[tuple[float, ...], ...]:
    try:
        matrix = np.array(rows, dtype=float)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError(f"{where}: rotation: {rows!r} is not 3 rows of 3 numbers")
    return tuple(tuple(row) for row in matrix.tolist())


def checksum(cameras: Mapping[str, Camera]) -> str:
    """Eight hexadecimal digits that are the same for the same calibrations, however their file is laid out."""
    return f"{zlib.crc32(repr(sorted(cameras.items())).encode()):08x}"


def cameras_from_mapping(content: Any, where: str) -> dict[str, Camera]:
    """Cameras by name from a mapping of camera mappings; an accuracy section is only checked.

    ``where`` is the prefix of every error. Raises InputError.
    """
    if not isinstance(content, Mapping) or not content:
        raise InputError(f"{where}: expected cameras by name (dorsal, lateral), got {content!r}")
    if SECTION in content:
        accuracy_from_mapping(content[SECTION], where)
    sections = camera_sections(content, where)
    return {name: camera_from_mapping(mapping, f"{where}: {name}") for name, mapping in sections.items()}


def camera_sections(content: Mapping[Any, Any], where: str) -> dict[str, Any]:
    """The sections of cameras.yaml that describe a camera, by its name. Raises InputError for an unknown name."""
    sections = {str(name): section for name, section in content.items() if name != SECTION}
    for name in sections:
        if name not in VIEWS:
            raise InputError(f"{where}: no camera is called {name!r}{did_you_mean(name, VIEWS)}")
    return sections


def read_cameras(path: Path | str) -> dict[str, Camera]:
    """The cameras of a YAML file, by name (``dorsal``, ``lateral``). Raises InputError."""
    return cameras_from_mapping(read_yaml(Path(path)), str(path))
