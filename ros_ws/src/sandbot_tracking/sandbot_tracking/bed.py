"""The background of grains, learnt from frames before a marker hides it.

Grains behind a disc's rim, not the camera's noise, limit the accuracy of its centre (benchmarks/tracking.md). A fixed
camera sees them before the marker comes: the background is each pixel's running mean over frames without a marker near
it. Old frames are forgotten, so a bed disturbed by feet is learnt again; until then disc.py detects the mismatch.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats, Frame
from sandbot_common.compiled import compiled

Picture = NDArray[np.float32]

MIN_FRAMES, MAX_FRAMES = 8, 40
"""Frames after which a pixel's background is known, and over which its mean runs."""
MARGIN_PX = 6.0
"""Margin around a marker's rim, for its scattered light and its motion."""
BAND_PX = 24.0
"""Rows farther than this from the markers are not updated: they are not needed soon, and a whole frame costs time."""


class StillBed:
    """The running background; ``picture`` is NaN where it is unknown, and empty before the first frame."""

    def __init__(self) -> None:
        self.picture: Picture = np.empty((0, 0), np.float32)
        self._mean: Picture = self.picture
        self._counts: NDArray[np.uint8] = np.empty((0, 0), np.uint8)

    def see(self, frame: Frame, markers: Floats, radii: Floats) -> None:
        """Learn from a frame with markers at (n, 2) of radii (n,) [px]: rows near them, or all if there are none."""
        if self._mean.shape != frame.shape:
            self._mean, self._counts = np.zeros(frame.shape, np.float32), np.zeros(frame.shape, np.uint8)
            self.picture = np.full(frame.shape, np.nan, np.float32)
        known = np.isfinite(markers[:, 0])
        xy, reach = np.ascontiguousarray(markers[known]), radii[known] + MARGIN_PX
        top, bottom = 0, frame.shape[0]
        if len(xy):
            top = max(0, int((xy[:, 1] - reach).min() - BAND_PX))
            bottom = min(bottom, int((xy[:, 1] + reach).max() + BAND_PX) + 1)
        _learn(frame, self._mean, self._counts, self.picture, xy, reach, top, bottom)


def background(frames: Iterable[Frame]) -> Picture:
    """The background from frames without markers, at least MIN_FRAMES of them."""
    bed = StillBed()
    for frame in frames:
        bed.see(frame, np.empty((0, 2)), np.empty(0))
    return bed.picture


@compiled
def _learn(frame, mean, counts, picture, xy, reach, top, bottom):  # type: ignore[no-untyped-def]
    hidden = np.empty(frame.shape[1], np.bool_)
    for row in range(top, bottom):
        hidden[:] = False
        for i in range(xy.shape[0]):
            square = reach[i] ** 2 - (row - xy[i, 1]) ** 2
            if square > 0.0:
                half = np.sqrt(square)
                hidden[max(0, int(xy[i, 0] - half)) : max(0, int(xy[i, 0] + half) + 2)] = True
        for column in range(frame.shape[1]):
            if hidden[column]:
                continue
            count = min(counts[row, column] + 1, MAX_FRAMES)
            counts[row, column] = count
            mean[row, column] += (frame[row, column] - mean[row, column]) / np.float32(count)
            if count >= MIN_FRAMES:
                picture[row, column] = mean[row, column]
