"""Whether a camera stays where it stood: the still picture behind the robot, compared with that at the trial's start.

A camera that is knocked shifts everything it sees, and the markers with it: 10 px in the middle of a walk make the
speed 6 % too high. Tiles of the picture are looked for in their surroundings by normalised correlation, without the
pixels' noise and the light's slow changes. The camera's shift is the tiles' median, as robot and footprints cover less
than half of them. Tiles without texture are left out, since they are not recognised even one frame later; where most
have none, nothing can be said.
"""

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats, Frame

CHECK_S = 0.5
"""Period of the checks: one takes 8 ms."""
ROWS, TILE_PX = 4, 64
"""Number of rows or columns of tiles along the shorter side, and their largest size."""
REACH_PX = 64
"""How far a tile is looked for. After a larger knock the markers are lost."""
FINE_PX, COARSE_PX = 1.0, 5.0
"""Texture is what is larger than the former and smaller than the latter."""
MOVED_PX = 1.0
"""A larger shift, in two checks in a row, is a move. In a walk of 150 px it changes the speed by less than 1 %."""
STILL_PX = 0.5
"""A tile with texture shifts by less from one frame to the next."""
RECOGNISED = 0.4
"""Least correlation of a tile that still shows what it showed."""
ENOUGH = 0.25
"""Fraction of tiles that must have texture; half of those must be recognised, and agree on the shift."""
ALIKE = 1.0, 0.3
"""Largest difference of a tile that agrees [px], and relative to the shift, as a camera that is knocked also turns."""


Picture = NDArray[np.float32]


@dataclass(frozen=True)
class _Tile:
    """A square piece of a picture, whose upper left corner was at (x, y)."""

    piece: Picture
    x: int
    y: int

    def find(self, picture: Picture) -> tuple[Floats, float]:
        """Its shift (2,) [px] in another picture, and its correlation there."""
        side, left, top = len(self.piece), max(self.x - REACH_PX, 0), max(self.y - REACH_PX, 0)
        around = picture[top : self.y + side + REACH_PX, left : self.x + side + REACH_PX]
        match = cv2.matchTemplate(np.ascontiguousarray(around), self.piece, cv2.TM_CCOEFF_NORMED)
        _, best, _, (x, y) = cv2.minMaxLoc(match)
        # A piece without any texture gives no number, or 1 everywhere; at an edge, the best place is beyond it.
        if not (0 < x < match.shape[1] - 1 and 0 < y < match.shape[0] - 1):
            return np.zeros(2), 0.0
        fine = _vertex(*match[y, x - 1 : x + 2]), _vertex(*match[y - 1 : y + 2, x])
        return np.array([left + x + fine[0] - self.x, top + y + fine[1] - self.y]), best


class CameraMotion:
    """Takes the frames of one camera from the trial's start on."""

    def __init__(self, rate_hz: float) -> None:
        """``rate_hz``: of the frames."""
        self.moved_px = 0.0
        """How far the camera has moved since the first frame; 0 while it stands still."""
        self._every, self._frames = max(round(rate_hz * CHECK_S), 1), 0
        self._tiles: list[_Tile] = []
        self._textured: NDArray[np.bool_] = np.empty(0, np.bool_)
        self._shift = np.zeros(2)

    def see(self, frame: Frame) -> None:
        """The next frame, mono8 (height, width)."""
        number, self._frames = self._frames, self._frames + 1
        if number == 0:
            self._tiles = _tiles(_texture(frame))
        elif number == 1 and self._tiles:
            shifts, recognised = self._shifts(frame)
            self._textured = recognised & (np.abs(shifts).max(axis=1) < STILL_PX)
        elif number % self._every == 0 and not self.moved_px and self._textured.sum() > ENOUGH * len(self._tiles):
            self._check(frame)

    def _check(self, frame: Frame) -> None:
        before, self._shift = self._shift, self._common(*self._shifts(frame))
        # One shift alone may be a shock that has passed.
        if min(np.hypot(*before), np.hypot(*self._shift)) > MOVED_PX > np.hypot(*(self._shift - before)):
            self.moved_px = float(np.hypot(*self._shift))

    def _common(self, shifts: Floats, recognised: NDArray[np.bool_]) -> Floats:
        """The shift (2,) [px] that most tiles agree on; 0 if there is none."""
        shifts = shifts[recognised & self._textured]
        if not len(shifts):
            return np.zeros(2)
        median = np.median(shifts, axis=0)
        agree = np.hypot(*(shifts - median).T) <= max(ALIKE[0], ALIKE[1] * np.hypot(*median))
        return median if agree.sum() >= self._textured.sum() / 2 else np.zeros(2)

    def _shifts(self, frame: Frame) -> tuple[Floats, NDArray[np.bool_]]:
        """Shift of each tile since the first frame, (n, 2) [px], and whether it is recognised, (n,)."""
        texture = _texture(frame)
        found = [tile.find(texture) for tile in self._tiles]
        return np.array([shift for shift, _ in found]), np.array([match for _, match in found]) > RECOGNISED


def _texture(frame: Frame) -> Picture:
    picture = frame.astype(np.float32)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), FINE_PX) - cv2.GaussianBlur(picture, (0, 0), COARSE_PX))


def _vertex(before: float, best: float, after: float) -> float:
    """Where a parabola through three equidistant values is highest, from the middle one."""
    curvature = before - 2 * best + after
    return float((before - after) / (2 * curvature)) if curvature < 0 else 0.0


def _tiles(texture: Picture) -> list[_Tile]:
    """Squares, evenly spaced over the picture."""
    rows, columns = texture.shape
    cell = max(min(rows, columns) // ROWS, 2)
    side = min(cell, TILE_PX)
    edge = (cell - side) // 2
    corners = product(range(edge, rows - side + 1, cell), range(edge, columns - side + 1, cell))
    return [_Tile(np.ascontiguousarray(texture[y : y + side, x : x + side]), x, y) for y, x in corners]
