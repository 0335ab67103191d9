"""Degrades the frames of one camera according to a world's ``film``."""

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Frame
from sandbot_common.errors import InputError
from sandbot_lab.drawing import draw_box, draw_disc
from sandbot_lab.film import Film

GLINT_GREY, CABLE_GREY = 240.0, 30.0
CABLE_AT = 0.4
"""Position of the cable, as a fraction of the picture's width: the robot walks past it."""
MAX_JITTER = 0.4
"""Largest fraction of a period by which a frame is early or late, so that frames keep their order."""


def check_jitter(film: Film, rate_hz: float) -> None:
    """Raises InputError if the jitter is too large for this frame rate."""
    if film.jitter_s * rate_hz > MAX_JITTER:
        raise InputError(
            f"film: jitter_s: {film.jitter_s:g} s is too much at {rate_hz:g} frames/s, which keep their order: at most "
            f"{MAX_JITTER / rate_hz:g} s"
        )


class Degradation:
    """Degrades the frames of one camera; randomness depends only on the seed and the frame's number."""

    def __init__(self, film: Film, name: str, seed: int, pedestal: float) -> None:
        """``pedestal``: the grey level that the noise, applied later, adds."""
        self._film, self._seed, self._pedestal = film, [seed, 0xF11], pedestal
        self._camera = [*self._seed, len(name)]

    def instant_s(self, number: int, rate_hz: float) -> float:
        """When a frame is taken, relative to frame 0."""
        if not self._film.jitter_s:
            return number / rate_hz
        off = self._film.jitter_s * rate_hz * self._rng(self._seed, number).standard_normal()
        return (number + float(np.clip(off, -MAX_JITTER, MAX_JITTER))) / rate_hz

    def comes(self, number: int) -> int:
        """How many times a frame is sent: once, never or twice."""
        if not (self._film.dropped or self._film.doubled):
            return 1
        drop, double = self._rng(self._camera, number).random(2)
        return 0 if drop < self._film.dropped else 2 if double < self._film.doubled else 1

    def degraded(self, image: Frame, t_s: float) -> Frame:
        """The image on the sensor, from a drawn picture (height, width) that may be modified in place."""
        film = self._film
        rows, columns = image.shape
        if film.glints:
            rng = self._rng(self._camera, round(t_s * 1e6))
            for _ in range(film.glints):
                u, v = rng.uniform(0, columns, 1), rng.uniform(0, rows, 1)
                draw_disc(image, u, v, float(rng.uniform(1.0, 2.0)), GLINT_GREY - self._pedestal)
        if film.cable_px:
            left, right = (np.array([CABLE_AT * columns + side * film.cable_px]) for side in (-0.5, 0.5))
            draw_box(image, left, right, np.array([-1.0]), np.array([rows + 1.0]), CABLE_GREY - self._pedestal)
        if film.defocus_px:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), film.defocus_px), np.uint8)
        if film.uneven or film.flicker:
            light = 1.0 + film.flicker * np.sin(2 * np.pi * film.flicker_hz * t_s)
            lit = (image + self._pedestal) * (light * self._field(rows, columns)) - self._pedestal
            image = np.clip(np.rint(lit), 0, 255).astype(np.uint8)
        return image

    def compressed(self, frame: Frame) -> Frame:
        """An exposed frame, JPEG-compressed and decoded."""
        if not self._film.jpeg_quality:
            return frame
        coded = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, self._film.jpeg_quality])[1]
        return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)

    def _field(self, rows: int, columns: int) -> NDArray[np.float32]:
        if self._light is None or self._light.shape != (rows, columns):
            across, down = np.linspace(-1, 1, columns) ** 2, np.linspace(-1, 1, rows)[:, None] ** 2
            self._light = (1.0 - self._film.uneven * (across + down) / 2).astype(np.float32)
        return self._light

    _light: NDArray[np.float32] | None = None

    @staticmethod
    def _rng(seed: list[int], number: int) -> np.random.Generator:
        return np.random.default_rng([*seed, number & 0xFFFFFFFF])
