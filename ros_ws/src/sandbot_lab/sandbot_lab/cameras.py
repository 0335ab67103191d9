"""The two virtual cameras: images of the robot on the grains, as 8-bit grey frames.

A frame is the mean over the exposure, stamped at its middle. The dorsal camera sees one reflective disc (`com`) on the
robot's top, which rises with the body; the lateral one sees two, on the front and the rear axle.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sandbot_common.arrays import Floats, Frame
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_lab.calibration import Calibration, calibration
from sandbot_lab.degradation import Degradation, check_jitter
from sandbot_lab.drawing import draw_box, draw_disc
from sandbot_lab.film import Film
from sandbot_lab.scenery import Scenery

BODY_LENGTH_M, BODY_WIDTH_M, BODY_HEIGHT_M = 0.30, 0.15, 0.12
MARKER_RADIUS_PX = 6.0

GRAIN_GREY, GRAIN_SD, SENSOR_SD = 64.0, 10.0, 6.0
BODY_GREY, CONTRAST = 45.0, 170.0
GLINTS, GLINT_GREY = 6, 110.0
LED_GREY = 250.0
EXPOSURES = 5
"""Moments within an exposure of which a frame is the mean."""
_NORMAL = {"dorsal": "z", "lateral": "y"}
_PEDESTAL = 4 * int(SENSOR_SD)
_SLACK = (96, 128)


class Motion(Protocol):
    """A moving body: arrays (n,) over time. A `sandbot_lab.robot.Trace` is one."""

    @property
    def t_s(self) -> Floats:
        """Time [s], rising."""

    @property
    def x_m(self) -> Floats:
        """Position of the com along the track."""

    @property
    def z_m(self) -> Floats:
        """Axle height."""

    @property
    def pitch_rad(self) -> Floats:
        """Nose-up pitch."""

    @property
    def leg_angle_rad(self) -> Floats:
        """Shaft angles of the legs, (n, legs)."""


class LabCamera:
    """One camera, ``dorsal`` or ``lateral``, over its own piece of ground; all randomness comes from ``seed``."""

    def __init__(
        self,
        name: str,
        camera: Mapping[str, Any],
        seed: int,
        robot: Robot = SANDBOT,
        film: Film | None = None,
        *,
        body: bool = True,
    ) -> None:
        """``camera``: its section of cameras.yaml; ``robot`` gives the marker positions; ``body``: draw a dark body."""
        if name not in _NORMAL:
            raise InputError(f"camera: {name!r} is not dorsal or lateral")
        self.name = name
        self.calibration: Calibration = calibration(camera, f"camera {name}")
        if self.calibration.plane["normal"] != (along := _NORMAL[name]):
            raise InputError(f"camera {name}: plane: the robot's markers move across {along}, so normal is {along}")
        self._body, self._robot = body, robot
        check_jitter(film or Film(), self.calibration.frame_rate_hz)
        self._degradation = Degradation(film or Film(), name, seed, _PEDESTAL)
        self._rng = np.random.default_rng([seed, len(name)])
        self._ground = _ground(self.calibration.height, self.calibration.width, self._rng)
        self._noise = _noise_tile(self.calibration.height + _SLACK[0], self.calibration.width + _SLACK[1])
        self._scenery = Scenery(name, self.calibration, robot, BODY_WIDTH_M, _PEDESTAL) if body else None
        if self._scenery is not None:
            self._scenery.prepare(self._ground)

    def render(
        self,
        x_m: ArrayLike,
        z_m: ArrayLike,
        pitch_rad: ArrayLike = 0.0,
        led_on: bool = False,
        legs_rad: Floats | None = None,
        t_s: float = 0.0,
    ) -> Frame:
        """A frame (height, width) of the robot with its com at x, its axles at height z, nose-up pitch.

        Arrays are the moments of the exposure, of which the frame is the mean. ``legs_rad`` are the shaft angles of the
        legs (legs,) in the middle of the exposure; without them no legs are drawn.
        """
        x, z, pitch = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(value, np.float64)) for value in (x_m, z_m, pitch_rad))
        )
        image = self._ground.copy()
        if self._body:
            self._draw_body(image, x, z)
        if self._scenery is not None and legs_rad is not None:
            self._scenery.legs(image, float(x.mean()), float(z.mean()), legs_rad)
        grey = (BODY_GREY if self._body else GRAIN_GREY) + CONTRAST - _PEDESTAL
        for marker in self.markers(x, z, pitch):
            points = self.calibration.pixels(marker)
            draw_disc(image, points[:, 0].copy(), points[:, 1].copy(), MARKER_RADIUS_PX, grey)
        if led_on and self.calibration.led_region is not None:
            left, top, width, height = self.calibration.led_region
            centre = np.array([left + 0.5 * (width - 1)]), np.array([top + 0.5 * (height - 1)])
            draw_disc(image, *centre, 0.4 * min(width, height), LED_GREY - _PEDESTAL)
        rows, columns = image.shape
        image = self._degradation.degraded(image, t_s)
        noisy: Frame = cv2.add(image, _window(self._noise, rows, columns, self._rng), dst=image)
        return self._degradation.compressed(noisy)

    def film(self, motion: Motion, t_s: float, led_on: bool = False) -> Frame:
        """The frame whose exposure is centred on ``t_s`` of a motion; before and after it the robot stands still."""
        moments = t_s + self.calibration.exposure_s * ((np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5)
        x, z = np.interp(moments, motion.t_s, motion.x_m), np.interp(moments, motion.t_s, motion.z_m)
        legs = motion.leg_angle_rad[min(int(np.searchsorted(motion.t_s, t_s)), len(motion.t_s) - 1)]
        if self._scenery is not None:
            self._scenery.step(self._ground, float(x.mean()), float(z.mean()), legs)
        return self.render(x, z, np.interp(moments, motion.t_s, motion.pitch_rad), led_on, legs, t_s)

    def instant_s(self, number: int) -> float:
        """When a frame is taken, relative to frame 0; numbers may be negative."""
        return self._degradation.instant_s(number, self.calibration.frame_rate_hz)

    def comes(self, number: int) -> int:
        """How many times a frame is sent: once unless ``film`` drops or doubles it."""
        return self._degradation.comes(number)

    def markers(self, x_m: Floats, z_m: Floats, pitch_rad: Floats) -> tuple[Floats, ...]:
        """Positions (n, 3) [m; trackway frame] of this camera's markers: (com,) or (front axle, rear axle)."""
        offset = self.calibration.plane_offset_m
        if self.name == "dorsal":
            return (np.stack((x_m, np.zeros_like(x_m), offset + z_m - self._robot.axle_height_m), axis=-1),)
        half = 0.5 * self._robot.axle_distance_m
        ahead, up = half * np.cos(pitch_rad), half * np.sin(pitch_rad)
        side = np.full_like(x_m, offset)
        return np.stack((x_m + ahead, side, z_m + up), axis=-1), np.stack((x_m - ahead, side, z_m - up), axis=-1)

    def _draw_body(self, image: Frame, x: Floats, z: Floats) -> None:
        half, offset, belly = 0.5 * BODY_LENGTH_M, self.calibration.plane_offset_m, z - self._robot.axle_height_m
        if self.name == "dorsal":
            side, top = np.full_like(x, 0.5 * BODY_WIDTH_M), offset + belly
            corners = np.stack((x - half, side, top), axis=-1), np.stack((x + half, -side, top), axis=-1)
        else:
            side = np.full_like(x, offset)
            corners = (
                np.stack((x - half, side, belly + BODY_HEIGHT_M), axis=-1),
                np.stack((x + half, side, belly), axis=-1),
            )
        (left, top), (right, bottom) = np.sort([self.calibration.pixels(corner).T for corner in corners], axis=0)
        draw_box(image, left, right, top, bottom, BODY_GREY - _PEDESTAL)


def check_cameras(sections: Mapping[str, Any], where: str) -> None:
    """Raise InputError, opened by ``where``, unless both cameras are present and valid."""
    for name in _NORMAL:
        if not isinstance(sections.get(name), Mapping):
            raise InputError(f"{where}: no {name!r} camera in it")
        try:
            LabCamera(name, sections[name], 0)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None


def _ground(rows: int, columns: int, rng: np.random.Generator) -> Frame:
    """A picture of the grains with a few dim glints, less the pedestal that the noise tile adds."""
    frame = _window(_grain_tile(rows + _SLACK[0], columns + _SLACK[1]), rows, columns, rng).copy()
    for _ in range(GLINTS):
        u, v = rng.uniform(0, columns, 1), rng.uniform(0, rows, 1)
        draw_disc(frame, u, v, float(rng.uniform(1.0, 2.0)), GLINT_GREY - _PEDESTAL)
    return frame


def _window(tile: Frame, rows: int, columns: int, rng: np.random.Generator) -> Frame:
    """A random window of the tile, which is far faster than drawing random numbers for every pixel."""
    row, column = rng.integers(0, _SLACK[0]), rng.integers(0, _SLACK[1])
    return tile[row : row + rows, column : column + columns]


@lru_cache(maxsize=4)
def _grain_tile(rows: int, columns: int) -> Frame:
    """Texture of grains about a pixel wide."""
    grains = cv2.GaussianBlur(np.random.default_rng(1).standard_normal((rows, columns), np.float32), (0, 0), 0.8)
    image = GRAIN_GREY - _PEDESTAL + grains * (GRAIN_SD / grains.std())
    return _grey(image)


@lru_cache(maxsize=4)
def _noise_tile(rows: int, columns: int) -> Frame:
    """Sensor noise on a pedestal."""
    noise = _PEDESTAL + SENSOR_SD * np.random.default_rng(0).standard_normal((rows, columns), np.float32)
    return _grey(noise)


def _grey(levels: NDArray[Any]) -> Frame:
    grey: Frame = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return grey
