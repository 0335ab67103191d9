"""Camera calibration: the lens from a board or from points in space, and the pose from points."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats, Frame
from sandbot_common.errors import InputError
from sandbot_tracking.source import Source


@dataclass(frozen=True)
class Lens:
    """Intrinsics: K (3, 3) and the five distortion coefficients."""

    matrix: Floats
    distortion: Floats


Sight = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Points of a board (n, 3) [m] and their pixels (n, 1, 2) in one frame."""
LEAST_FRAMES, LEAST_CORNERS = 3, 8


@dataclass(frozen=True)
class Board:
    """A board with ``pattern`` inner corners; a ChArUco board if ``dictionary`` names its markers."""

    pattern: tuple[int, int]
    square_m: float
    dictionary: str = ""
    marker: float = 0.75
    """A marker's side as a fraction of its square's."""

    def __str__(self) -> str:
        return f"{self.pattern[0]}x{self.pattern[1]} {'ChArUco board' if self.dictionary else 'chessboard'}"

    def seen(self, frame: Frame) -> Sight | None:
        """The board's corners in one frame, None if it is not seen; a ChArUco board may be partly in view."""
        return self._chessboard(frame) if not self.dictionary else self._charuco(frame)

    def _chessboard(self, frame: Frame) -> Sight | None:
        found, pixels = cv2.findChessboardCornersSB(frame, self.pattern)
        corners = np.zeros((self.pattern[0] * self.pattern[1], 3), np.float32)
        corners[:, :2] = np.mgrid[: self.pattern[0], : self.pattern[1]].T.reshape(-1, 2) * self.square_m
        return (corners, pixels) if found else None

    def _charuco(self, frame: Frame) -> Sight | None:
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        squares = (self.pattern[0] + 1, self.pattern[1] + 1)
        board = cv2.aruco.CharucoBoard(squares, self.square_m, self.marker * self.square_m, markers)
        pixels, which, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(frame)
        if which is None or len(which) < LEAST_CORNERS:
            return None
        return board.getChessboardCorners()[which.ravel()], pixels.reshape(-1, 1, 2)


def lens_from_board(path: str, board: Board) -> Lens:
    """Intrinsics from a video, or a folder of pictures, that shows a board. Raises InputError."""
    sights, size = list[Sight](), (0, 0)
    for frame in _frames(path):
        size = frame.shape[1], frame.shape[0]
        if (sight := board.seen(frame)) is not None:
            sights.append(sight)
    if len(sights) < LEAST_FRAMES:
        raise InputError(f"{path}: a {board} is seen in {len(sights)} frames, {LEAST_FRAMES} are needed")
    points, pixels = zip(*sights, strict=True)
    with _in_one_thread():
        _, matrix, distortion, *_ = cv2.calibrateCamera(points, pixels, size, None, None)
    return Lens(matrix, distortion.ravel()[:5])


@contextmanager
def _in_one_thread() -> Iterator[None]:
    """Make OpenCV deterministic: its sums over frames depend on the order of threads, and so would the lens."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _frames(path: str) -> Iterator[Frame]:
    """The frames of a video, or the pictures of a folder, which must all have one size."""
    if not Path(path).is_dir():
        with Source(path) as source:
            yield from source
        return
    size = None
    for file in sorted(entry for entry in Path(path).iterdir() if entry.is_file()):
        picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if picture is None:
            raise InputError(f"{file}: not a readable picture")
        if size not in (None, picture.shape):
            raise InputError(f"{file}: {picture.shape[1]}x{picture.shape[0]} px, the one before {size[1]}x{size[0]}")
        size = picture.shape
        yield np.asarray(picture, np.uint8)


def picture_size(path: str) -> tuple[int, int] | None:
    """Width and height [px] of a video, or of the pictures of a folder; None if it is empty. Raises InputError."""
    first = next(_frames(path), None)
    return None if first is None else (first.shape[1], first.shape[0])


def place(pixels: Floats, points_m: Floats, lens: Lens) -> tuple[Floats, Floats]:
    """Camera centre (3,) [m] and rotation (3, 3) from points seen through a known lens. Raises InputError."""
    with _solvable():
        ok, turn, shift = cv2.solvePnP(points_m, pixels, lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_SQPNP)
        if not ok:
            raise InputError(_UNDETERMINED)
        turn, shift = cv2.solvePnPRefineLM(points_m, pixels, lens.matrix, lens.distortion, turn, shift)
    rotation = cv2.Rodrigues(turn)[0]
    return -rotation.T @ shift.ravel(), rotation


_UNDETERMINED = "the points do not determine where the camera stands: spread them over the view, in pixels and metres"


@contextmanager
def _solvable() -> Iterator[None]:
    """Say of points from which OpenCV can solve nothing what is wrong with them."""
    try:
        yield
    except cv2.error:
        raise InputError(_UNDETERMINED) from None


def lens_from_points(pixels: Floats, points_m: Floats, size: tuple[int, int]) -> Lens:
    """Focal lengths from points in space, with the principal point fixed at the middle and no distortion.

    Raises InputError.
    """
    if np.linalg.matrix_rank(points_m - points_m.mean(axis=0), tol=1e-3) < 3:
        raise InputError(
            "all points lie in one plane: give --intrinsics or a chessboard video, or points off the plane"
        )
    focal = 1.5 * max(size)
    start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]], float)
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    )  # fmt: skip
    with _solvable():
        _, matrix, *_ = cv2.calibrateCamera(
            [points_m.astype(np.float32)], [pixels.astype(np.float32)], size, start, np.zeros(5), flags=flags
        )
    return Lens(matrix, np.zeros(5))


def entry(
    lens: Lens, position_m: Floats, rotation: Floats, size: tuple[int, int], plane: dict[str, Any]
) -> dict[str, Any]:
    """A cameras.yaml entry as plain numbers."""
    return {
        "width": size[0],
        "height": size[1],
        "fx": float(lens.matrix[0, 0]),
        "fy": float(lens.matrix[1, 1]),
        "cx": float(lens.matrix[0, 2]),
        "cy": float(lens.matrix[1, 2]),
        "distortion": [float(value) for value in lens.distortion],
        "position_m": [float(value) for value in position_m],
        "rotation": [[float(value) for value in row] for row in rotation],
        "plane": plane,
    }


def misfits_px(pixels: Floats, points_m: Floats, lens: Lens, position_m: Floats, rotation: Floats) -> Floats:
    """Distances (n,) between pixels and projected points [px]."""
    turn, shift = cv2.Rodrigues(rotation)[0], -rotation @ position_m
    seen = cv2.projectPoints(points_m, turn, shift, lens.matrix, lens.distortion)[0][:, 0]
    return np.asarray(np.linalg.norm(seen - pixels, axis=1), dtype=float)
