"""The grains as they lie, learnt from frames: what the marker hides is known if it was seen before.

Grains behind a disc's rim, not the camera's noise, limit where it is (benchmarks/tracking.md). A fixed camera sees them
before the marker comes: each pixel's mean over the last looks without a marker near it. Looks are forgotten, so a bed
that feet stir up is learnt anew; until then disc.py notices that it is no longer so.
"""

from collections.abc import Iterable

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Frame = NDArray[np.uint8]
Picture = NDArray[np.float32]

LEAST, MOST = 8, 40
"""Looks after which a pixel is known, and over how many its mean runs."""
MARGIN_PX = 6.0
"""Beyond a marker's rim its light is still felt, and it may have moved."""
BAND_PX = 24.0
"""Rows so far from the markers are not kept up: they are not needed next, and a whole frame costs time."""


class StillBed:
    """A running picture of the bed; ``picture`` is NaN where it is not known, and empty before the first frame."""

    def __init__(self) -> None:
        self.picture: Picture = np.empty((0, 0), np.float32)
        self._mean: Picture = self.picture
        self._looks: NDArray[np.uint8] = np.empty((0, 0), np.uint8)

    def see(self, frame: Frame, markers: Floats, radii: Floats) -> None:
        """Learn from a frame with markers at (n, 2) of radii (n,) [px]: rows near them, or all where there are none."""
        if self._mean.shape != frame.shape:
            self._mean, self._looks = np.zeros(frame.shape, np.float32), np.zeros(frame.shape, np.uint8)
            self.picture = np.full(frame.shape, np.nan, np.float32)
        known = np.isfinite(markers[:, 0])
        xy, reach = np.ascontiguousarray(markers[known]), radii[known] + MARGIN_PX
        top, bottom = 0, frame.shape[0]
        if len(xy):
            top = max(0, int((xy[:, 1] - reach).min() - BAND_PX))
            bottom = min(bottom, int((xy[:, 1] + reach).max() + BAND_PX) + 1)
        _learn(frame, self._mean, self._looks, self.picture, xy, reach, top, bottom)


def learnt(frames: Iterable[Frame]) -> Picture:
    """The picture of a bed from frames without markers, LEAST at least."""
    bed = StillBed()
    for frame in frames:
        bed.see(frame, np.empty((0, 2)), np.empty(0))
    return bed.picture


@numba.njit(cache=True)
def _learn(frame, mean, looks, picture, xy, reach, top, bottom):  # type: ignore[no-untyped-def]
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
            count = min(looks[row, column] + 1, MOST)
            looks[row, column] = count
            mean[row, column] += (frame[row, column] - mean[row, column]) / np.float32(count)
            if count >= LEAST:
                picture[row, column] = mean[row, column]
