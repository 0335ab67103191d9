"""What stood about while the markers were seen is none of them, however much it looks like one.

A reflection or a screw head may be as round and as bright as a marker. One frame in which every marker was in sight
tells it apart once one of them is lost: whatever is found where that frame had a disc already was never it.
"""

import numpy as np
from numpy.typing import NDArray

from sandbot_tracking import disc
from sandbot_tracking.markers import Floats, Frame, follow

STILL_PX = 3.0
"""A thing that stands is found again so near: camera noise and a table that shakes move it less."""
AS_BRIGHT = 0.5
"""Part of its contrast that it had in the earlier frame at least; a dim glint under a marker has less."""


class Bystanders:
    """Keeps the last frame that it was given of those that show all markers."""

    def __init__(self) -> None:
        self._frame: Frame = np.empty((0, 0), np.uint8)
        self._markers: Floats = np.empty((0, 2))

    def see(self, frame: Frame, markers: Floats) -> None:
        """A frame that shows all markers, at (n, 2) [px]."""
        # A copy, for drivers and decoders fill the same memory again; into memory of its own, which is quicker.
        if self._frame.shape != frame.shape:
            self._frame = np.empty(frame.shape, np.uint8)
        np.copyto(self._frame, frame)
        self._markers = markers.copy()

    def among(self, rows: Floats) -> NDArray[np.bool_]:
        """Which of discs (n, 7), rows of disc.py, stood there then, (n,). A marker's own place is no other's."""
        then = follow(self._frame, rows[:, :2], rows[:, disc.RADIUS], np.zeros(len(rows)))
        moved = np.linalg.norm(then[:, :2] - rows[:, :2], axis=1)
        own = np.linalg.norm(then[:, None, :2] - self._markers, axis=2) <= rows[:, [disc.RADIUS]]
        bright = then[:, disc.GREY_STEP] >= AS_BRIGHT * rows[:, disc.GREY_STEP]
        return np.asarray((moved <= STILL_PX) & bright & ~own.any(axis=1))
