"""The sync LED in the frames, which synchronises video time with the robot's clock."""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Frame
from sandbot_common.errors import InputError

RISE = 40.0
"""Grey levels."""


class LedEdge:
    """Detects when the LED in a region (x, y, width, height) [px] goes on.

    On: the mean of the region's brightest quarter exceeds its level when off by ``RISE``.
    """

    def __init__(self, region: Sequence[int]) -> None:
        if len(region) != 4 or min(region) < 0 or min(region[2:]) < 1:
            raise InputError(f"LED region {list(region)}: x, y, width, height in pixels are needed")
        self._region = tuple(region)
        self._off: float | None = None
        self.on = False

    def update(self, frame: Frame) -> bool:
        """True in the one frame in which the LED is first seen on. Raises InputError if the region is outside."""
        x, y, width, height = self._region
        if x + width > frame.shape[1] or y + height > frame.shape[0]:
            raise InputError(
                f"LED region {list(self._region)} is outside the frame of {frame.shape[1]}x{frame.shape[0]}"
            )
        pixels = np.sort(frame[y : y + height, x : x + width], axis=None)
        level = float(pixels[-max(1, pixels.size // 4) :].mean())
        if self._off is None:
            self._off = level
        was, self.on = self.on, level > self._off + RISE
        if not self.on:
            self._off = level if level < self._off else 0.9 * self._off + 0.1 * level
        return self.on and not was
