"""Excludes stationary objects that look like markers.

A reflection or a screw head may be as round and as bright as a marker. A frame in which all markers were in sight
distinguishes them once a marker is lost: a disc that was already in that frame, apart from the markers, is not the
lost one.
"""

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats, Frame
from sandbot_tracking import disc
from sandbot_tracking.markers import follow

STILL_PX = 3.0
"""Largest apparent motion of a stationary object: camera noise and vibration move it less."""
MIN_CONTRAST_RATIO = 0.5
"""Smallest contrast in the earlier frame relative to now; a dim glint under a marker has less."""


class Distractors:
    """Keeps the last given frame, in which all markers were in sight."""

    def __init__(self) -> None:
        self._frame: Frame = np.empty((0, 0), np.uint8)
        self._markers: Floats = np.empty((0, 2))

    def see(self, frame: Frame, markers: Floats) -> None:
        """A frame that shows all markers, at (n, 2) [px]."""
        # A copy, because drivers and decoders reuse their buffers; into an existing array, which is faster.
        if self._frame.shape != frame.shape:
            self._frame = np.empty(frame.shape, np.uint8)
        np.copyto(self._frame, frame)
        self._markers = markers.copy()

    def among(self, rows: Floats) -> NDArray[np.bool_]:
        """Which discs (n, 7), rows of disc.py, were already in that frame and were not markers, (n,)."""
        then = follow(self._frame, rows[:, :2], rows[:, disc.RADIUS], np.zeros(len(rows)))
        moved = np.linalg.norm(then[:, :2] - rows[:, :2], axis=1)
        own = np.linalg.norm(then[:, None, :2] - self._markers, axis=2) <= rows[:, [disc.RADIUS]]
        bright = then[:, disc.GREY_STEP] >= MIN_CONTRAST_RATIO * rows[:, disc.GREY_STEP]
        return np.asarray((moved <= STILL_PX) & bright & ~own.any(axis=1))
